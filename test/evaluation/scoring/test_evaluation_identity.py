"""The identity of an evaluation: it tells what results depend on, and names what has changed."""

import dataclasses
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest

import lrtrav_ros
from lrtrav_ros.evaluation.scoring import evaluation_identity as evaluation_identity_module
from lrtrav_ros.evaluation.scoring.evaluation_identity import EvaluationIdentity, evaluation_identity
from lrtrav_ros.evaluation.scoring.frame_evaluation import make_setup
from lrtrav_ros.evaluation.scoring.methods import choose_methods
from lrtrav_ros.evaluation.scoring.score_records import from_json, to_json
from lrtrav_ros.evaluation.truth.labels import Labels
from lrtrav_ros.evaluation.truth.mat_files import MatFields
from lrtrav_ros.evaluation.truth.opening import NamedSet, ReaderOptions
from lrtrav_ros.offline.run_identity import code_digest

PACKAGE = Path(lrtrav_ros.__file__).parent


def identity(*methods, values=None, n_seeds=5, save_masks=False, unknown="", **reading):
    setup = make_setup(choose_methods(methods), values or {}, n_seeds=n_seeds, save_masks=save_masks)
    return evaluation_identity(setup, ReaderOptions(**reading), unknown=unknown)


def digest_of(package):
    return code_digest(package, without=evaluation_identity_module._WITHOUT_INFLUENCE)


USUAL = identity("proposed", "robust")


@pytest.fixture
def package(tmp_path):
    """A copy of the package's sources."""
    return Path(shutil.copytree(PACKAGE, tmp_path / "copy", ignore=shutil.ignore_patterns("__pycache__")))


@pytest.mark.parametrize(
    "name", ["config.py", "detector.py", "method/ground.py", "method/matching/elas.py", "io/image_files.py",
             "evaluation/scoring/scores.py", "evaluation/truth/labels.py", "method/new.py"],
)  # fmt: skip
def test_digest_depends_on_every_source_that_results_do(package, name):
    before = digest_of(package)
    assert before == digest_of(PACKAGE)
    with (package / name).open("a", encoding="utf-8") as file:
        file.write("# changed\n")
    assert digest_of(package) != before


@pytest.mark.parametrize("name", ["commands/evaluate.py", "nodes/worker.py", "evaluation/report/charts.py", "README"])
def test_digest_does_not_depend_on_what_results_do_not(package, name):
    before = digest_of(package)
    with (package / name).open("a", encoding="utf-8") as file:
        file.write("# changed\n")
    assert digest_of(package) == before


def test_digest_depends_on_the_place_of_a_source(package):
    before = digest_of(package)
    (package / "camera.py").rename(package / "method" / "camera.py")
    assert digest_of(package) != before


def test_identity_is_the_same_after_json():
    assert from_json(EvaluationIdentity, to_json(USUAL)) == USUAL
    assert identity("proposed", "robust") == USUAL
    assert USUAL.changes_since(USUAL) == []


@pytest.mark.parametrize(
    ("changed", "changes"),
    [
        (identity("proposed", "robust", values={"clustering.k": 5}),
         ["clustering.k of proposed: 0 -> 5", "clustering.k of robust: 10 -> 5"]),
        (identity("proposed", "robust", values={"stereo.matcher": "bm"}), ["stereo.matcher: elas -> bm"]),
        (identity("proposed", "robust", values={"ground.shape": "line"}), ["ground.shape of robust: curved -> line"]),
        (identity("proposed", "robust", values={"source.max_depth_m": 10.0}), ["source.max_depth_m: 0.0 -> 10.0"]),
        (identity("robust"), ["--methods: proposed, robust -> robust"]),
        (identity("robust", "proposed"), ["--methods: proposed, robust -> robust, proposed"]),
        (identity("proposed", "robust", unknown="ignore"), ["--unknown: default -> ignore"]),
        (identity("proposed", "robust", labels=Labels(0, 1, 2)), ["--labels: default -> 0,1,2"]),
        (identity("proposed", "robust", truth=Path("/data/gt")), ["--truth: default -> /data/gt"]),
        (identity("proposed", "robust", fields=MatFields(disparity="disp")),
         ["--field disparity: im_disparity -> disp"]),
        (identity("proposed", "robust", save_masks=True), ["--save-masks: no -> yes"]),
        (dataclasses.replace(USUAL, code="other"), ["the code of lrtrav_ros"]),
        (dataclasses.replace(USUAL, libraries={**USUAL.libraries, "numpy": "9.9"}),
         [f"numpy: {USUAL.libraries['numpy']} -> 9.9"]),
    ],
)  # fmt: skip
def test_changes_are_named(changed, changes):
    assert changed.changes_since(USUAL) == changes


def test_geometry_is_named_where_it_alone_has_changed():
    earlier, now = identity("proposed"), identity("proposed", values={"ground.shape": "line"})
    assert now.changes_since(earlier) == ["ground.shape of the distances: curved -> line"]


def test_seeds_count_where_a_method_has_several():
    assert identity("proposed", "robust", n_seeds=3) == USUAL
    changes = identity("random_centres", n_seeds=3).changes_since(identity("random_centres"))
    assert changes == ["--seeds: 5 -> 3"]


def test_libraries_are_those_that_compute():
    assert list(USUAL.libraries) == ["numpy", "scipy", "cv2", "numba"]
    assert list(identity("near_to_far").libraries) == ["numpy", "scipy", "cv2", "numba", "sklearn"]


def test_another_set_of_the_same_name_is_told_and_a_further_one_is_not():
    setup = make_setup(choose_methods(["proposed"]), {}, n_seeds=1)

    def of_sets(**places):
        sets = [NamedSet(name, SimpleNamespace(path=Path(place))) for name, place in places.items()]
        return evaluation_identity(setup, ReaderOptions(), sets=sets, unknown="")

    first = of_sets(road="/a/road")
    assert of_sets(road="/b/road").changes_since(first) == ["the place of road: /a/road -> /b/road"]
    assert of_sets(road="/a/road", park="/a/park").changes_since(first) == []
