"""Says who it is, repeats what it is told, and ends with code 3."""

from __future__ import annotations

import os
import sys


def main() -> int:
    sys.stdout.write(f"{os.getpid()} {' '.join(sys.argv[1:])}\n")
    sys.stdout.flush()
    for line in sys.stdin:
        sys.stdout.write(line)
        sys.stdout.flush()
    sys.stderr.write("no more\n")
    return 3


if __name__ == "__main__":
    sys.exit(main())
