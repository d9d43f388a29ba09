"""Run the command line: `python -m omnimj` is the same as `omnimj`."""

import sys

from omnimj.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
