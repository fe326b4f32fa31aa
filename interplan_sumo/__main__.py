"""`python -m interplan_sumo` is the command `interplan-sumo`."""

import sys

from interplan_sumo.cli import main

if __name__ == "__main__":
    sys.exit(main())
