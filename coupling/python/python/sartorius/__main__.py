"""`python -m sartorius` is the command `sartorius`."""

import signal
import sys

from . import _core


def main() -> int:
    # The command hears Ctrl-C itself, and says what it leaves.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _core.run_command(["sartorius", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
