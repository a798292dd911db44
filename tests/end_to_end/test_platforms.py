"""What runs without ROS runs where Windows' Python and macOS' do: without the modules that only Linux has."""

import json
import subprocess
import sys
from pathlib import Path

DEMO = Path(__file__).parents[2] / "bags" / "demo"
QUICK = ["--track", "bilbao-viscous", "--speeds", "80,160", "--positions", "2", "--uncertainty-samples", "0"]

ELSEWHERE = """
import builtins, os, pathlib, signal, sys
import numba, platformdirs, plotext  # these choose by the name of the system, which stays
MISSING = {"rclpy", "fcntl", "resource", "termios", "tty", "pty", "pwd", "grp", "syslog"}
class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in MISSING:
            raise ModuleNotFoundError(f"{name} is blocked", name=name)
sys.meta_path.insert(0, Blocker())
for name in MISSING & sys.modules.keys():
    sys.modules.pop(name)
for module, names in (
    (os, "O_DIRECTORY fork forkpty getuid geteuid getgid setsid getpgid killpg sync fdatasync sysconf statvfs uname "
         "getloadavg sched_getaffinity posix_fadvise pread pwrite mkfifo chown fchown fchmod wait3 wait4 nice"),
    (signal, "SIGHUP SIGUSR1 SIGUSR2 SIGKILL SIGALRM SIGQUIT pthread_sigmask setitimer"),
):
    for name in names.split():
        if hasattr(module, name):
            delattr(module, name)
really_open = builtins.open
def no_proc(file, *arguments, **more):
    if str(file).startswith("/proc"):
        raise FileNotFoundError(2, "no such file", str(file))
    return really_open(file, *arguments, **more)
builtins.open = no_proc
"""


def elsewhere(program: str) -> str:
    """Run a program where those modules are blocked, and return what it prints."""
    done = subprocess.run([sys.executable, "-c", ELSEWHERE + program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def command(*arguments: object) -> str:
    return f"from weld_force_ros.cli.main import main\nassert main({[str(one) for one in arguments]!r}) == 0\n"


def test_files_become_forces_verdicts_and_pages(tmp_path: Path):
    page, again = tmp_path / "page.html", tmp_path / "again.html"
    maps = elsewhere(
        command(
            "assess",
            "weld-5-ramp-protrusion",
            *QUICK,
            "--line-speed",
            "160",
            "--report",
            page,
            "--as",
            "csv",
            "--fail-on",
            "reject",
        )
        + command("report", DEMO, "-o", again)
        + command("simulate", "weld-5-ramp-protrusion", *QUICK, "--json", "-")
    )
    header, verdict, *_, force_map = maps.splitlines()
    assert header.startswith("decision,weld,")
    assert ",weld-5-ramp-protrusion," in verdict
    assert json.loads(force_map)["weld_id"] == "weld-5-ramp-protrusion"
    for written, weld in ((page, "weld-5-ramp-protrusion"), (again, "weld-4-steep-ramp")):
        text = written.read_text()
        assert weld in text
        assert text.rstrip().endswith("</html>")


def test_recordings_are_shown_mended_and_exported(tmp_path: Path):
    shown = elsewhere(
        command("show", DEMO, "weld-1-dip")
        + command("bag", "recover", DEMO, tmp_path / "recovered")
        + command("bag", "export", DEMO, tmp_path / "tables")
    )
    assert "GRIND weld-1-dip" in shown
    assert (tmp_path / "recovered" / "metadata.yaml").is_file()
    assert (tmp_path / "tables" / "verdicts.csv").is_file()


def test_a_recording_is_computed_again():
    recording = Path(__file__).parents[1] / "data" / "demo-1.2"
    assert "not computed: 0" in elsewhere(command("replay", "what-if", recording, "--speeds", "80,100"))


def test_a_recorder_says_what_it_lacks(tmp_path: Path):
    program = (
        "from weld_force_ros.errors import BagError\nfrom weld_force_ros.recording import recorder\n"
        f"try:\n    recorder.Recorder(pathlib.Path({str(tmp_path / 'bag')!r}))\nexcept BagError as error:\n"
        "    print(error)\n"
    )
    assert "Windows cannot record; record on Linux" in elsewhere(program)
