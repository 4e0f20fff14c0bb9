"""Opening sets: their names, and what is none."""

import pytest
from recorded import frames, rendered, write_dataset

from lrtrav_ros.evaluation.truth.opening import ReaderOptions, open_set, open_sets

FRAME, TRUTH = frames()[0], rendered()[0].truth


def test_sets_are_named_by_their_folders(tmp_path):
    paths = [write_dataset(tmp_path / name, frames(n=1), truth=True) for name in ("a/DS1A", "b/DS1A", "b/other")]
    assert [item.name for item in open_sets(paths[1:], ReaderOptions())] == ["DS1A", "other"]
    assert [item.name for item in open_sets(paths, ReaderOptions())] == ["a_DS1A", "b_DS1A", "b_other"]
    with pytest.raises(ValueError, match="named twice"):
        open_sets([paths[0], tmp_path / "b" / ".." / "a" / "DS1A"], ReaderOptions())


def test_what_is_no_set_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere"):
        open_set(tmp_path / "nowhere", ReaderOptions())
    folder = write_dataset(tmp_path / "unlabelled", frames(n=1))
    with pytest.raises(ValueError, match="no frame has ground truth"):
        open_set(folder, ReaderOptions())
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match="holds no ground truth"):
        open_set(tmp_path / "empty", ReaderOptions())


@pytest.mark.parametrize(
    ("paths", "names"),
    [
        (["a/b", "c/d"], ["b", "d"]),
        (["a/d", "c/d"], ["a_d", "c_d"]),
        (["p/a/b_c", "p/a_b/c", "r/zz/c"], ["b_c_1", "c_2", "c_3"]),
    ],
)
def test_sets_have_different_names(tmp_path, paths, names):
    paths = [write_dataset(tmp_path / path, frames(n=1), truth=True) for path in paths]
    assert [item.name for item in open_sets(paths, ReaderOptions())] == names
