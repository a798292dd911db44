"""The scripts of the pages, tested in node: the tests are `*.test.js` beside this file."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from weld_force_ros.campaign import summary
from weld_force_ros.report import html_page

ROOT = Path(__file__).parents[2]
NODE = shutil.which("node")
LEAST_VERSION = 20


def node_version() -> int:
    return int(subprocess.check_output([NODE, "--version"], text=True).removeprefix("v").partition(".")[0])


@pytest.mark.skipif(NODE is None, reason="no node was found on PATH (apt install nodejs)")
def test_scripts_in_node():
    if (version := node_version()) < LEAST_VERSION:
        pytest.skip(f"node {version} is too old: {LEAST_VERSION} or later runs these tests")
    tests = sorted(Path(__file__).parent.glob("*.test.js"))
    done = subprocess.run([NODE, "--test", *tests], capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    passed = re.search(r"^# pass (\d+)$|^ℹ pass (\d+)$", done.stdout, re.MULTILINE)
    assert passed, done.stdout
    assert int(passed.group(1) or passed.group(2)) >= len(tests)


@pytest.mark.parametrize(
    ("program", "scripts"), [("tsconfig.json", html_page.SCRIPTS), ("tsconfig.campaign.json", summary.SCRIPTS)]
)
def test_the_type_checker_reads_what_a_page_holds(program, scripts):
    text = "\n".join(line for line in (ROOT / program).read_text().splitlines() if not line.strip().startswith("//"))
    checked = [Path(name).name for name in json.loads(text)["files"]]
    assert checked == ["types.d.ts", *scripts]
