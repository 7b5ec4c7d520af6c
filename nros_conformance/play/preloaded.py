"""Processes whose wall clock can be set, forked from an interpreter that has libfaketime preloaded.

Some ms each, where an interpreter of its own takes 0.1 s of a core before it does anything for the play.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from multiprocessing.connection import Connection, Pipe, wait

from nros_conformance.play.faketime import preload
from nros_conformance.play.forked import die_with_parent

_MODULE = "nros_conformance.play.preloaded"


class Preloaded:
    """A process that serves ``connection`` as `session_process.serve` does; it ends with this one at the latest.

    It can set its wall clock (`faketime.set_ahead`). Raises `NoFaketime`; TimeoutError when the interpreter has not
    started within ``start_s``, and ChildProcessError when it has ended.
    """

    def __init__(self, connection: Connection, start_s: float) -> None:
        self._told, tell = Pipe(duplex=False)
        self._reading = threading.Lock()
        self._code: int | None = None
        with tell:
            asked = server.fork(connection.fileno(), tell.fileno())
        if not self._told.poll(start_s):
            server.give_up(asked)
            raise TimeoutError(f"the interpreter with libfaketime has not started within {start_s:g} s")
        try:
            self.pid: int = self._told.recv()
        except EOFError as error:  # its descriptors are closed some time before it counts as ended
            server.give_up(asked)
            raise ChildProcessError("the interpreter with libfaketime has ended") from error

    def wait(self, timeout_s: float) -> int | None:
        """The exit code (negative: the signal that killed it), or None when it still runs."""
        if self._code is None and wait([self._told], timeout_s):
            with self._reading:
                if self._code is None:
                    self._code = self._read()
        return self._code

    def _read(self) -> int:
        try:
            return int(self._told.recv())
        except (EOFError, OSError):  # the server has died, and with it all its children
            return -signal.SIGKILL


class Server:
    """The interpreter that they are forked from; started when it is first needed."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._control: socket.socket | None = None
        self._process: subprocess.Popen[bytes] | None = None

    def fork(self, *descriptors: int) -> subprocess.Popen[bytes]:
        """Ask for a process with these descriptors; closes none of them. Returns whom it asked. Raises `NoFaketime`."""
        with self._lock:
            if self._process is None or self._process.poll() is not None:
                self._end()
                self._start()
            assert self._control is not None
            assert self._process is not None
            with contextlib.suppress(OSError):  # it has ended, which the other ends of the descriptors tell
                socket.send_fds(self._control, [b"fork"], descriptors)
            return self._process

    def give_up(self, asked: subprocess.Popen[bytes]) -> None:
        """End the one that was ``asked``, unless another thread has and there is a new one by now."""
        with self._lock:
            if self._process is asked:
                self._end()

    def stop(self) -> None:
        """End it, and all that was forked from it."""
        with self._lock:
            self._end()

    def _end(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
        if self._control is not None:
            self._control.close()
        self._process = self._control = None

    def _start(self) -> None:
        environment = {**os.environ, **preload()}
        self._control, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", _MODULE, str(theirs.fileno())],
                pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL, env=environment,
            )  # fmt: skip


server = Server()
"""The one of this process."""

atexit.register(server.stop)


def main() -> None:
    """Entry of ``python -m nros_conformance.play.preloaded FD``: forks until the other end of FD is closed."""
    from nros_conformance.play.session_process import serve  # what each of them needs is loaded once

    control = socket.socket(fileno=int(sys.argv[1]))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever started it decides
    ended, wake = socket.socketpair()
    wake.setblocking(False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(wake.fileno(), warn_on_full_buffer=False)
    living: dict[int, Connection] = {}
    while True:
        ready, _, _ = select.select([control, ended], [], [])
        if ended in ready:
            ended.recv(4096)
            _reap(living)
        if control not in ready:
            continue
        order, descriptors, _, _ = socket.recv_fds(control, 16, 2)
        if not order:
            os._exit(0)
        connection, tell = (Connection(descriptor) for descriptor in descriptors)
        pid = os.fork()
        if not pid:
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            for end in (control, ended, wake):
                end.close()
            for other in (tell, *living.values()):
                other.close()
            die_with_parent()
            setattr(time, "sleep", _sleep)  # noqa: B010 - an assignment would have to take SupportsIndex too
            serve(connection)
        connection.close()
        living[pid] = tell
        tell.send(pid)


def _reap(living: dict[int, Connection]) -> None:
    for pid in list(living):
        ended, status = os.waitpid(pid, os.WNOHANG)
        if ended:
            with living.pop(pid) as tell, contextlib.suppress(OSError):  # nobody wants to know
                tell.send(os.waitstatus_to_exitcode(status))


def _sleep(seconds: float) -> None:
    """In the place of `time.sleep`: libfaketime 0.9.10 answers EINVAL to its clock_nanosleep on the monotonic clock."""
    select.select([], [], [], seconds)


if __name__ == "__main__":
    main()
