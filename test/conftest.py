"""The environment of ROS for the tests, set before anything of ROS is imported, and the fixtures of the node tests.

Hypothesis has the profile ``ci`` here, the same few examples in every run; ``make fuzz`` takes ``fuzz``.
"""

import importlib
import os
import signal
import tempfile
import warnings
from pathlib import Path

from lrtrav_ros.nodes import shared_memory  # imports nothing of ROS

# A domain of its own, 1 to 50, keeps runs apart, of this user and of others on the same network, and each process of a
# run from the others; `measure_nodes` takes those above.
_WORKER = os.environ.get("PYTEST_XDIST_WORKER", "")
os.environ["ROS_DOMAIN_ID"] = str(1 + ((os.getppid() + int(_WORKER[2:])) if _WORKER else os.getpid()) % 50)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
shared_memory.use_segment(shared_memory.IMAGES_PROFILE)
_LOGS = tempfile.TemporaryDirectory(prefix="lrtrav_ros_log_")
os.environ["ROS_LOG_DIR"] = _LOGS.name
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # in the background of a shell, and so in all that tests start
    signal.signal(signal.SIGINT, signal.default_int_handler)
os.environ.setdefault("HYPOTHESIS_STORAGE_DIRECTORY", str(Path(__file__).parents[1] / ".cache/hypothesis"))

import cluster  # noqa: E402
import joblib  # noqa: E402
import pytest  # noqa: E402
from hypothesis import HealthCheck, Phase, settings  # noqa: E402
from hypothesis.internal.conjecture import providers  # noqa: E402

_ANY = settings(
    deadline=None,  # how fast a computer is tells nothing
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    phases=[phase for phase in Phase if phase is not Phase.explain],
)
settings.register_profile("ci", _ANY, derandomize=True, database=None, max_examples=10)
settings.register_profile("fuzz", _ANY, max_examples=50)
settings.load_profile("fuzz" if "FUZZ_MINUTES" in os.environ else "ci")
if "FUZZ_MINUTES" not in os.environ and hasattr(providers, "_get_local_constants"):
    # Newer versions of Hypothesis try the numbers in all modules that are loaded, which depends on the tests before.
    providers._get_local_constants = lambda: providers._local_constants


@pytest.fixture(scope="session", autouse=True)
def _two_processors():
    """Let detectors have two threads also where there is one processor: what threads share is tested everywhere."""
    n_processors = max(joblib.cpu_count(), 2)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("joblib.cpu_count", lambda *_, **__: n_processors)
        yield


@pytest.fixture(scope="session")
def dask_cluster(tmp_path_factory):
    """A Dask cluster with one worker, for all tests of the run; each adds the workers that it kills."""
    pytest.importorskip("distributed")
    with cluster.cluster(tmp_path_factory.mktemp("dask")) as started:
        yield started


@pytest.fixture(scope="session")
def ros():
    """Initialise rclpy for the run."""
    rclpy = pytest.importorskip("rclpy")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the parser that rclpy imports with the first message
        importlib.import_module("rosidl_generator_py")
    options = importlib.import_module("rclpy.signals").SignalHandlerOptions.NO  # signals are the tests' own
    rclpy.init(args=[], signal_handler_options=options)
    yield
    rclpy.try_shutdown()
