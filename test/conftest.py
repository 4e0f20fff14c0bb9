"""The environment of ROS for the tests, set before anything of ROS is imported, and the fixtures of the node tests."""

import importlib
import os
import tempfile
import warnings

from lrtrav_ros.nodes import shared_memory  # imports nothing of ROS

# A domain of its own keeps runs apart, of this user and of others on the same network.
os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
shared_memory.use_segment(shared_memory.IMAGES_PROFILE)
_LOGS = tempfile.TemporaryDirectory(prefix="lrtrav_ros_log_")
os.environ["ROS_LOG_DIR"] = _LOGS.name

import cluster  # noqa: E402
import pytest  # noqa: E402


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
