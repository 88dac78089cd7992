"""``python -m vnav``: the command line."""

import sys

from vnav.cli.main import main

sys.exit(main())
