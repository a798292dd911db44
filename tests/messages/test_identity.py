"""Which measurement a message is about, and the hash of its samples, which other languages can compute."""

import hashlib
import json
import shutil
import struct
import subprocess
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from weld_force_ros.errors import MessageError
from weld_force_ros.messages import (
    WeldProfile,
    decode,
    encode,
    identity,
    measurement_id,
    profile_identity,
    profile_sha256,
    stated_identity,
)

ROOT = Path(__file__).parents[2]
VECTOR = ROOT / "examples" / "weld_profile.json"
NODE = shutil.which("node")


def vector(**changes: object) -> str:
    content = json.loads(VECTOR.read_text()) | changes
    return json.dumps({key: value for key, value in content.items() if value is not None})


def test_the_vector_s_hash_is_that_of_its_bytes_and_the_documented_one() -> None:
    stated = json.loads(VECTOR.read_text())
    # Each double by itself, the sign of the one negative zero dropped by hand.
    doubles = [0.0 if value == 0 else value for value in stated["x_m"] + stated["z_m"]]
    assert str(stated["z_m"][1]) == "-0.0"
    by_hand = hashlib.sha256(b"".join(struct.pack("<d", value) for value in doubles)).hexdigest()
    assert stated["profile_sha256"] == by_hand == decode(WeldProfile, VECTOR.read_bytes()).profile_sha256
    assert by_hand in (ROOT / "docs" / "clients.md").read_text()


@pytest.mark.skipif(NODE is None, reason="no node was found on PATH (apt install nodejs)")
def test_javascript_makes_the_same_hash() -> None:
    script = ROOT / "examples" / "profile_sha256.mjs"
    done = subprocess.run([str(NODE), str(script), str(VECTOR)], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.strip() == json.loads(VECTOR.read_text())["profile_sha256"]


def test_the_receiver_fills_in_a_hash_that_is_not_stated() -> None:
    stated = decode(WeldProfile, vector())
    assert decode(WeldProfile, vector(profile_sha256=None)) == stated
    assert identity(stated) == profile_identity(vector(profile_sha256=None))


def test_a_wrong_hash_is_refused_and_both_are_named() -> None:
    right = json.loads(VECTOR.read_text())["profile_sha256"]
    with pytest.raises(MessageError) as caught:
        decode(WeldProfile, vector(profile_sha256="0" * 64))
    assert "0" * 64 in str(caught.value)
    assert right in str(caught.value)
    with pytest.raises(MessageError):
        decode(WeldProfile, vector(profile_sha256=""))


def test_the_hash_of_contracts_until_1_5_is_accepted_and_kept() -> None:
    stated = json.loads(VECTOR.read_text())
    # As msgspec writes them: without spaces, with exponents for the smallest only. No other library does.
    text = "[[-0.05,-0.045,-0.04,-0.035,-0.03,-0.025,-0.02,-0.015,-0.01,-0.005,0.0,0.005,0.01,0.015,0.02,0.025,0.03,"
    text += "0.035,0.04,0.045,0.05],[0.0,-0.0,-0.0000125,-0.000025,-0.000041,-0.000063,-0.000088,-0.000117,-0.00015,"
    text += (
        "-0.000171,-0.00018,-0.000172,-0.000149,-0.000118,-0.000089,-0.000062,-0.00004,-0.000024,-0.000012,2e-6,0.0]]"
    )
    assert json.loads(text) == [stated["x_m"], stated["z_m"]]
    until_1_5 = hashlib.sha256(text.encode()).hexdigest()
    read = decode(WeldProfile, vector(profile_sha256=until_1_5, schema_version="1.5"))
    assert read.profile_sha256 == until_1_5
    assert decode(WeldProfile, encode(read)) == read


def test_a_broken_message_is_known_by_its_text_as_its_rejection_is() -> None:
    broken = vector(z_m=[0.0] * 3, publisher="/trolley#1", sequence=3, profile_id="a" * 64)
    content = hashlib.sha256(broken.encode()).hexdigest()
    assert profile_identity(broken) == measurement_id("weld_profile message 3 of /trolley#1", content)
    assert profile_identity("{") == measurement_id("weld_profile message", hashlib.sha256(b"{").hexdigest())
    corrected = vector(publisher="/trolley#1", sequence=4, profile_id="a" * 64)
    assert profile_identity(corrected) == "a" * 64


def test_stated_identities_are_taken_as_they_are_unless_somebody_has_them() -> None:
    broken = vector(z_m=[0.0] * 3, profile_id="a" * 64)
    assert stated_identity(broken, lambda _: False) == "a" * 64
    assert stated_identity(broken, lambda _: True) == profile_identity(broken) != "a" * 64
    assert stated_identity("{", lambda _: False) == profile_identity("{")
    unnamed = vector(profile_sha256=None)
    assert stated_identity(unnamed, lambda _: False) == profile_identity(unnamed)


@given(st.lists(st.floats(-1.0, 1.0, allow_subnormal=True), min_size=1, max_size=9))
def test_the_hash_does_not_see_the_sign_of_a_zero(heights: list[float]) -> None:
    places = [float(i) for i in range(len(heights))]
    turned = [-value if value == 0 else value for value in heights]
    assert profile_sha256(places, turned) == profile_sha256(places, heights)
