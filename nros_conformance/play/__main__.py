"""A worker: ``python -m nros_conformance.play FD``.

A forked process imports the main module of whoever had it forked again (7 ms), unless it has this name.
"""

from nros_conformance.play.worker import main

if __name__ == "__main__":
    main()
