"""``python -m lrtrav_ros COMMAND``: the ``lrtrav`` command, run with a Python interpreter of your choice."""

import sys

from lrtrav_ros.commands import run_lrtrav

if __name__ == "__main__":
    sys.exit(run_lrtrav(sys.argv[1:]))
