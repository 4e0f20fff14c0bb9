"""Recorders of bags."""

import pytest
from recorder import Recorder

from lrtrav_ros.io.bag_writer import FORMATS


@pytest.fixture
def recorder(tmp_path):
    """A recorder of an MCAP bag, which `read` closes."""
    return Recorder(tmp_path / "bag")


@pytest.fixture(params=FORMATS)
def any_recorder(request, tmp_path):
    return Recorder(tmp_path / "bag", request.param)
