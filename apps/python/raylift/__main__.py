"""`python -m raylift`: the program."""

import sys

from ._commands import main

sys.exit(main())
