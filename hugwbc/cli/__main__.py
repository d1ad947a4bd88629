"""`python -m hugwbc.cli`."""

import sys

from hugwbc.cli import main

if __name__ == "__main__":
    sys.exit(main())
