"""Run the command as `python -m weld_force_ros.cli`."""

import sys

from weld_force_ros.cli.main import main

sys.exit(main())
