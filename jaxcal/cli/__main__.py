"""`python -m jaxcal.cli`, for use when the script `jaxcal` is not on the path."""

import sys

from . import main

if __name__ == "__main__":
    sys.exit(main())
