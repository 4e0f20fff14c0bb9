"""``python -m lrtrav_ros COMMAND``: the command ``lrtrav``, with a Python of one's choice."""

import sys

from lrtrav_ros.commands import run_lrtrav

if __name__ == "__main__":
    sys.exit(run_lrtrav(sys.argv[1:]))
