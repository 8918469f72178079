"""What Windows and macOS lack is used behind a guard only, and a server, a training and an evaluation need none of it.

This is tested on Linux. It says nothing about what other libraries do there.
"""

import ast
import signal
import subprocess
import sys

import pytest

from joybridge.contract.address import READY, address
from tests.support.command_line import joybridge
from tests.support.servers import ROOT
from tests.support.wire import SECONDS
from tests.support.without_posix import PAIR, REMOVED

LACKING = {
    "os": """O_CLOEXEC O_DIRECT O_DIRECTORY O_NOFOLLOW O_NONBLOCK WEXITSTATUS WIFEXITED WIFSIGNALED WNOHANG chown chroot
        eventfd fork forkpty fsync getegid geteuid getgid getgroups getloadavg getpgid getpgrp getpriority getsid getuid
        kill killpg lchown memfd_create mkfifo mknod nice openpty pidfd_open pipe2 posix_fadvise posix_spawn pread
        preadv pwrite pwritev sched_getaffinity sched_setaffinity sched_yield sendfile setgid setpgid setpriority setsid
        setuid splice statvfs sync sysconf tcgetpgrp uname wait wait3 wait4 waitid""",
    "signal": """SIGALRM SIGBUS SIGCHLD SIGCONT SIGHUP SIGIO SIGKILL SIGPIPE SIGPROF SIGQUIT SIGSTOP SIGTSTP SIGUSR1
        SIGUSR2 SIGWINCH alarm getitimer pause pthread_kill pthread_sigmask setitimer siginterrupt sigpending
        sigtimedwait sigwait sigwaitinfo""",
    "socket": "AF_NETLINK AF_PACKET AF_UNIX CMSG_LEN MSG_DONTWAIT MSG_NOSIGNAL SCM_RIGHTS SO_PEERCRED SO_REUSEPORT",
    "select": "epoll kqueue poll",
    "asyncio": "open_unix_connection start_unix_server",
    "subprocess": "preexec_fn pass_fds",
}
METHODS = {  # of event loops and sockets, whatever they are called
    "add_reader",
    "add_signal_handler",
    "add_writer",
    "create_unix_connection",
    "create_unix_server",
    "recvmsg",
    "remove_reader",
    "remove_signal_handler",
    "sendmsg",
}
MODULES = {"fcntl", "grp", "posix", "pty", "pwd", "resource", "syslog", "termios", "tty"}
PLACES = ("/dev/", "/proc/", "/sys/", "/tmp/")
NAMES = {f"{module}.{name}" for module, names in LACKING.items() for name in names.split()}
GUARDED = {  # where another function has made sure
    "proto/joybridge/conformance/examination.py": {"socket.AF_UNIX"},  # `address` refuses unix: without it
    "proto/joybridge/contract/local_socket.py": {
        "os.getuid",
        "select.poll",
        "socket.AF_UNIX",
        "socket.MSG_DONTWAIT",
    },  # a client asks for it if it has both
    "simulator/joybridge/adapters/pygame_programs/inside/__main__.py": {
        "signal.SIGALRM",
        "signal.SIGCHLD",
        "signal.setitimer",
    },  # `adapt` refuses before, here and in the next five
    "simulator/joybridge/adapters/pygame_programs/inside/fences.py": {"resource", "/proc/self/fd/"},
    "simulator/joybridge/adapters/pygame_programs/inside/player.py": {"signal.setitimer"},
    "simulator/joybridge/adapters/pygame_programs/inside/stem.py": {"os.fork"},
    "simulator/joybridge/adapters/pygame_programs/processes.py": {
        "os.killpg",
        "signal.SIGALRM",
        "signal.SIGKILL",
        "socket.AF_UNIX",
    },
    "simulator/joybridge/adapters/pygame_programs/wire.py": {"/proc/self/fd/", "socket.AF_UNIX"},
    "simulator/joybridge/simulator/local_socket.py": {"socket.AF_UNIX"},  # `offer` returns None before
    "simulator/joybridge/simulator/workers/link.py": {"os.kill", "signal.SIGKILL"},  # where there is SO_PEERCRED
    "simulator/joybridge/simulator/workers/process.py": {
        "os.killpg",
        "signal.SIGKILL",
        "subprocess.pass_fds",
    },  # `load_games` refuses workers
    "simulator/joybridge/simulator/server.py": {"socket.AF_UNIX"},  # `address`, as above
    "trainer/joybridge/client/own_runs.py": {"os.geteuid"},  # Windows is asked for before
    "trainer/joybridge/run/origin.py": {"/proc/cpuinfo"},  # a file that is not there is an empty answer
    "trainer/joybridge/config/files.py": {"os.fsync"},  # of files everywhere; `sync_folder` ends on Windows before
}
SOURCES = [
    path for side in ("proto", "simulator", "trainer") for path in sorted((ROOT / side / "joybridge").rglob("*.py"))
]


def lacking(source):
    """Yield what a source uses that Windows or macOS lack, with the lines of unguarded uses."""
    tree = ast.parse(source)
    above = {child: node for node in ast.walk(tree) for child in ast.iter_child_nodes(node)}
    for node in ast.walk(tree):
        name = used(node)
        if name and not guarded(node, name, above):
            yield name


def used(node):
    """Return the name of what a node uses of these systems' lacks, or ""."""
    if isinstance(node, ast.Attribute):
        name = ast.unparse(node)
        return name if name in NAMES else node.attr if node.attr in METHODS else ""
    if isinstance(node, ast.keyword):
        return f"subprocess.{node.arg}" if f"subprocess.{node.arg}" in NAMES else ""
    if isinstance(node, ast.Import):
        return next((alias.name for alias in node.names if alias.name in MODULES), "")
    if isinstance(node, ast.ImportFrom):
        found = {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)} & (MODULES | NAMES)
        return next(iter(found), "")
    text = node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""
    return text if text.startswith(PLACES) else ""


def guarded(node, name, above):
    """Return whether a condition or an exception around a node is about systems that lack its name."""
    attribute = name.rpartition(".")[2]
    while node in above:
        node = above[node]
        if isinstance(node, ast.If | ast.IfExp):
            condition = ast.unparse(node.test)
            if f"'{attribute}'" in condition or "os.name" in condition:
                return True
        if isinstance(node, ast.Try) and any(
            "NotImplementedError" in ast.unparse(h.type) for h in node.handlers if h.type
        ):
            return True
        if isinstance(node, ast.With) and "suppress(NotImplementedError)" in ast.unparse(node.items[0]):
            return True
    return False


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("os.getuid()", ["os.getuid"]),
        ("from os import fork", ["os.fork"]),
        ("import fcntl", ["fcntl"]),
        ("if hasattr(os, 'getuid'):\n    os.getuid()", []),
        ("signal.SIGHUP if hasattr(signal, 'SIGHUP') else 1", []),
        ("loop.add_signal_handler(2, f)", ["add_signal_handler"]),
        ("with suppress(NotImplementedError):\n    loop.add_signal_handler(2, f)", []),
        ("open('/proc/self/status')", ["/proc/self/status"]),
        ("subprocess.run([], preexec_fn=f)", ["subprocess.preexec_fn"]),
        ("process.kill()", []),
    ],
)
def test_what_these_systems_lack_is_noticed(source, found):
    assert list(lacking(source)) == found


def test_nothing_that_these_systems_lack_is_used_without_a_guard():
    assert len(SOURCES) > 100
    found = {str(path.relative_to(ROOT)): set(lacking(path.read_text(encoding="utf-8"))) for path in SOURCES}
    assert {path: names for path, names in found.items() if names} == GUARDED


def test_a_server_a_training_and_an_evaluation_need_nothing_of_it(tmp_path, monkeypatch):
    command = [sys.executable, str(ROOT / "tests/support/without_posix.py")]
    serve = [*command, "serve", "--address", "127.0.0.1:0", "--with-parent"]
    with subprocess.Popen(serve, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None and server.stdin is not None
        place = server.stdout.readline().removeprefix(READY).strip()
        for module, name in REMOVED:
            monkeypatch.delattr(module, name)
        monkeypatch.setattr("socket.socketpair", PAIR)
        monkeypatch.setattr("joybridge.client.signals._SIGNALS", [signal.SIGINT, signal.SIGTERM])
        monkeypatch.chdir(tmp_path)
        small = ["arenas=8", "pipeline_groups=1", "total_timesteps=480", "policy.epochs=1", "policy.minibatch_size=240"]
        trained = joybridge("train", "archer/hybrid", *small, "--run", "run", "--simulator", place)
        assert trained.status == 0, trained.errors
        evaluated = joybridge("evaluate", "run", "--episodes", "8", "--simulator", place)
        assert evaluated.status == 0 and "mean and 95 % confidence" in evaluated.output
        server.stdin.close()  # its parent has gone
        assert server.wait(SECONDS) == 0


def test_unix_addresses_are_refused_where_there_are_none(monkeypatch):
    assert address("unix:socket") == "unix:socket"
    monkeypatch.delattr("socket.AF_UNIX")
    with pytest.raises(Exception, match="Python has no Unix sockets on this system; use HOST:PORT"):
        address("unix:socket")
