"""From a simulated trolley through ROS topics to measurement files; and what hostile or odd drivers send."""

import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import UNSET
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import String
from std_srvs.srv import Trigger

from tests.harness.ros import DEADLINE_S, Outcomes, Probe, wait_until
from weld_force_ros.errors import InputError, MessageError
from weld_force_ros.measurement.profile_file import read_profile
from weld_force_ros.messages import MAX_SAMPLES, RailSurface, Rejection, WeldMarker, decode, encode
from weld_force_ros.ros import point_cloud, qos
from weld_force_ros.ros.contract_topics import ContractTopics
from weld_force_ros.ros.lifecycle import LifecycleNodeBase
from weld_force_ros.ros.nodes import trolley_input
from weld_force_ros.ros.nodes.trolley_input import TrolleyInput
from weld_force_ros.ros.nodes.trolley_node import TrolleyNode

EXAMPLE = Path(__file__).parents[3] / "examples" / "trolley_driver.py"


class Listening(LifecycleNodeBase):
    """What the profile node has of a trolley, without the rest."""

    kind = "profile_node"

    def _configure(self, values: dict[str, Any]) -> None:
        self.topics = self._resources.enter_context(ContractTopics(self, [Rejection]))
        folder = Path(values["folder"])
        self.trolley = self._resources.enter_context(TrolleyInput(self, folder, self.topics, values))

    @property
    def pending(self) -> int:
        return 0


@pytest.fixture
def spinning(domain_id: int) -> Iterator[Callable[..., Any]]:
    """Makes nodes and spins them."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain_id, signal_handler_options=SignalHandlerOptions.NO)
    executor = SingleThreadedExecutor(context=context)
    nodes: list[LifecycleNodeBase] = []

    def make(kind: type[LifecycleNodeBase], **values: Any) -> Any:
        given = [Parameter(name, value=value) for name, value in values.items()]
        node = kind(context=context, parameter_overrides=given)
        nodes.append(node)
        executor.add_node(node)
        node.start()
        return node

    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    yield make
    executor.shutdown()
    thread.join(DEADLINE_S)
    for node in nodes:
        node.close()
        node.destroy_node()
    context.try_shutdown()


@pytest.fixture
def rejections(probe: Probe) -> Outcomes:
    collected = Outcomes()
    probe.collect("rejection", String, qos.CONTRACT).forward = lambda m: collected(decode(Rejection, m.data))
    return collected


@pytest.fixture
def publisher(domain_id: int) -> Iterator[Callable[..., Callable[[Any], None]]]:
    """Publishers of a foreign node, each made once its subscriber is there."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain_id, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("driver", context=context)

    def make(
        topic: str, kind: type = String, profile: QoSProfile = qos.STREAM, *, acknowledged: bool = False
    ) -> Callable[[Any], None]:
        made = node.create_publisher(kind, topic, profile)
        wait_until(lambda: made.get_subscription_count() > 0)

        def publish(message: Any) -> None:
            made.publish(String(data=message) if isinstance(message, str) else message)
            if acknowledged:
                wait_until(lambda: made.wait_for_all_acked(Duration()))

        return publish

    yield make
    node.destroy_node()
    context.try_shutdown()


@contextmanager
def caller(domain_id: int) -> Iterator[Callable[[], Trigger.Response]]:
    """Presses the button from another process's point of view."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain_id, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("caller", context=context)
    executor = SingleThreadedExecutor(context=context)
    client = node.create_client(Trigger, "capture_weld")
    executor.add_node(node)

    def call() -> Trigger.Response:
        assert client.wait_for_service(DEADLINE_S)
        future = client.call_async(Trigger.Request())
        executor.spin_until_future_complete(future, DEADLINE_S)
        return future.result()

    yield call
    executor.shutdown()
    node.destroy_node()
    context.try_shutdown()


def files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.csv"))


def peak_map(first_m: float, last_m: float, sequence: int = 0) -> str:
    x = np.round(np.arange(first_m, last_m, 1e-3), 6)
    height = (np.sin(x * 30) * 50).tolist()
    batch = RailSurface(
        chainage=x.tolist(), chainage_unit="m", height=height, height_unit="um", height_positive="up", sequence=sequence
    )
    return encode(batch).decode()


@pytest.mark.parametrize(
    ("form", "marks"), [("json", "marker"), ("json", "service"), ("points", "marker"), ("points", "service")]
)
def test_every_weld_of_a_simulated_run_becomes_one_file(
    spinning: Callable[..., Any], folder: Path, form: str, marks: str
) -> None:
    listening = spinning(Listening, folder=str(folder), rail="left")
    trolley = spinning(TrolleyNode, form=form, marks=marks, length_m=40.0, rate=30.0, seed=4)
    wait_until(lambda: trolley.finished and len(files(folder)) == len(trolley.rail.welds))
    profiles = [read_profile(file) for file in files(folder)]
    near_m = 1e-6 if marks == "marker" else 0.01  # pressed where the trolley stands, known to some samples
    assert [p.chainage_m for p in profiles] == pytest.approx([w.chainage_m for w in trolley.rail.welds], abs=near_m)
    for profile in profiles:
        x = np.array(profile.x_m)
        z = trolley.rail.height_m(profile.chainage_m + x)
        z -= np.interp(x, x[[0, -1]], z[[0, -1]])
        assert np.sqrt(np.mean((profile.z_m - z) ** 2)) < 2e-6  # 1 um of noise, and the levelling through two samples
    if marks == "marker":
        assert [p.weld_id for p in profiles] == [w.weld_id for w in trolley.rail.welds]
    wait_until(lambda: listening.trolley.facts()["welds captured"] == len(profiles))
    assert listening.trolley.facts()["welds marked, rail awaited"] == 0


def test_marking_is_answered_by_what_was_measured(
    spinning: Callable[..., Any], folder: Path, publisher: Callable[..., Any], domain_id: int
) -> None:
    listening = spinning(Listening, folder=str(folder))
    measure = publisher("rail_surface")
    with caller(domain_id) as press:
        early = press()
        measure(peak_map(0.0, 1.0))
        wait_until(lambda: listening.trolley.facts().get("trolley at m") == "0.997")
        pressed = press()
        wait_until(lambda: listening.trolley.facts()["welds marked, rail awaited"] == 1)
        listening.trigger_deactivate()
        inactive = press()
    assert [r.success for r in (early, pressed, inactive)] == [False, True, False]
    assert "nothing was measured yet" in early.message
    assert "0.997 m" in pressed.message
    assert "activate it" in inactive.message
    measure(peak_map(1.0, 2.0, 1))  # waits in the middleware
    listening.trigger_activate()
    wait_until(lambda: files(folder))
    assert read_profile(files(folder)[0]).chainage_m == pytest.approx(0.997, abs=1e-6)


@pytest.mark.parametrize("form", ["json", "points"])
def test_a_mark_does_not_overtake_the_samples_before_it(
    spinning: Callable[..., Any], folder: Path, publisher: Callable[..., Any], form: str
) -> None:
    listening = spinning(Listening, folder=str(folder))
    topic, kind = ("rail_surface", String) if form == "json" else ("rail_surface_points", PointCloud2)
    measure, mark = publisher(topic, kind, acknowledged=True), publisher("weld_marker", acknowledged=True)

    def measure_from(number: int) -> None:
        x = np.arange(0.1 * number, 0.1 * number + 0.1, 1e-3)
        measure(peak_map(x[0], x[-1], number) if form == "json" else point_cloud.cloud_of(x, np.sin(x * 30) * 5e-5))

    busy, free = threading.Event(), threading.Event()
    listening.executor.create_task(lambda: busy.set() or free.wait(DEADLINE_S))
    assert busy.wait(DEADLINE_S)
    for number in range(20):
        measure_from(number)
    mark(encode(WeldMarker()).decode())
    free.set()
    wait_until(lambda: listening.trolley.facts().get("welds marked, rail awaited") == 1)
    for number in range(20, 30):
        measure_from(number)
    wait_until(lambda: files(folder))
    assert read_profile(files(folder)[0]).chainage_m == pytest.approx(2.0, abs=0.01)


def test_what_was_queued_is_handled_before_the_node_lets_go(
    spinning: Callable[..., Any], folder: Path, publisher: Callable[..., Any]
) -> None:
    listening = spinning(Listening, folder=str(folder))
    measure, mark = publisher("rail_surface"), publisher("weld_marker")
    measure(peak_map(0.0, 1.105))
    wait_until(lambda: listening.trolley.facts())
    mark(encode(WeldMarker(chainage_m=0.6)).decode())
    mark(encode(WeldMarker(chainage_m=0.9, weld_id="later", sequence=1)).decode())
    wait_until(lambda: listening.topics.diagnostics.received["weld_marker"] == 2)
    listening.close()  # the trolley still stands over the first weld; its metre is measured
    assert [read_profile(file).chainage_m for file in files(folder)] == [0.6]
    again = spinning(Listening, folder=str(folder))
    publisher("rail_surface")(peak_map(0.3, 2.0))
    wait_until(lambda: again.trolley.facts().get("welds captured") == 1)
    assert read_profile(files(folder)[1]).weld_id == "later"


def test_a_mark_of_which_nothing_comes_is_rejected_with_its_text(
    spinning: Callable[..., Any], folder: Path, publisher: Callable[..., Any], rejections: Outcomes
) -> None:
    listening = spinning(Listening, folder=str(folder), mark_timeout_s=1.0)
    mark = publisher("weld_marker")
    here = encode(WeldMarker()).decode()
    for text in (here, encode(WeldMarker(chainage_m=5.0, weld_id="../../x", sequence=1)).decode(), "{"):
        mark(text)
    found = {rejection.raw_text: rejection for rejection in rejections.wait(3)}
    unmeasured, broken = found.pop(here), found.pop("{")
    (overdue,) = found.values()
    assert "nothing was measured yet" in unmeasured.reason
    assert "WeldMarker" in broken.remedy
    assert "not measured within 1 s" in overdue.reason
    assert len({r.profile_id for r in rejections.messages}) == 3
    listening.close()  # a mark is rejected before this is written to the disk
    assert [path.name for path in folder.parent.rglob("*") if path.is_file()] == [".weld-marks.json"]


def test_lost_batches_are_counted(spinning: Callable[..., Any], folder: Path, publisher: Callable[..., Any]) -> None:
    listening = spinning(Listening, folder=str(folder))
    measure = publisher("rail_surface")
    measure(peak_map(0.0, 1.0, 0))
    measure(peak_map(1.0, 2.0, 3))
    wait_until(lambda: listening.topics.diagnostics.received["rail_surface"] == 2)
    assert listening.topics.diagnostics.gaps() == 2


def test_a_flood_of_batches_waits_and_none_is_lost(
    spinning: Callable[..., Any], folder: Path, publisher: Callable[..., Any]
) -> None:
    listening = spinning(Listening, folder=str(folder))
    measure = publisher("rail_surface")
    for number in range(300):
        measure(peak_map(0.1 * number, 0.1 * number + 0.1, number))
    queued = []

    def taken() -> bool:
        queued.append(listening.trolley.pending)
        return float(str(listening.trolley.facts().get("trolley at m", 0))) == pytest.approx(29.997, abs=3e-3)

    wait_until(taken)
    assert listening.topics.diagnostics.received["rail_surface"] == 300
    assert listening.topics.diagnostics.gaps() == 0
    assert max(queued) <= 66  # the limit, one in hand, and one that was under way


@pytest.mark.parametrize("reliability", [ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT])
def test_drivers_of_either_reliability_are_heard(
    spinning: Callable[..., Any], folder: Path, publisher: Callable[..., Any], reliability: ReliabilityPolicy
) -> None:
    listening = spinning(Listening, folder=str(folder))
    profile = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=100, reliability=reliability)
    publish = publisher("rail_surface_points", PointCloud2, profile)
    x = np.arange(0.0, 1.0, 1e-3)
    publish(point_cloud.cloud_of(x, np.where(x < 0.5, np.nan, 0.0)))
    publish(PointCloud2(height=1, width=5, point_step=4))
    wait_until(lambda: listening.trolley.facts().get("point clouds refused") == 1)
    assert listening.trolley.facts()["trolley at m"] == "0.997"
    assert listening.trolley.facts()["rail samples that are no numbers"] == 500
    wait_until(lambda: "bytes for 1 rows" in listening.topics.diagnostics.last_error)


def test_json_of_a_driver_with_sensor_data_quality_is_heard(
    spinning: Callable[..., Any], folder: Path, publisher: Callable[..., Any]
) -> None:
    listening = spinning(Listening, folder=str(folder))
    publish = publisher("rail_surface", profile=qos_profile_sensor_data)
    for sequence in range(20):
        publish(peak_map(0.1 * sequence, 0.1 * sequence + 0.099, sequence))
    wait_until(lambda: listening.topics.diagnostics.received["rail_surface"] == 20)
    assert listening.topics.diagnostics.gaps() == 0


LAYOUTS = st.fixed_dictionaries(
    {
        "big": st.booleans(),
        "x_double": st.booleans(),
        "z_double": st.booleans(),
        "before": st.integers(0, 9),
        "between": st.integers(0, 9),
        "after": st.integers(0, 9),
        "width": st.integers(1, 5),
        "height": st.integers(1, 4),
        "row_padding": st.integers(0, 9),
        "z_first": st.booleans(),
    }
)


@settings(deadline=None, max_examples=150)
@given(LAYOUTS, st.randoms())
def test_any_layout_of_points_is_read_as_written(layout: dict[str, Any], random: Any) -> None:
    """The oracle packs point by point with `struct`."""
    order = ">" if layout["big"] else "<"
    form = {"x": "d" if layout["x_double"] else "f", "z": "d" if layout["z_double"] else "f"}
    names = ("z", "x") if layout["z_first"] else ("x", "z")
    first = layout["before"]
    second = first + struct.calcsize(form[names[0]]) + layout["between"]
    step = second + struct.calcsize(form[names[1]]) + layout["after"]
    offsets = dict(zip(names, (first, second), strict=True))
    data, expected = bytearray(), []
    for _ in range(layout["height"]):
        for _ in range(layout["width"]):
            point = bytearray(step)
            sample = {name: float(np.float32(random.uniform(-1e4, 1e4))) for name in names}
            for name in names:
                struct.pack_into(order + form[name], point, offsets[name], sample[name])
            data += point
            expected.append((sample["x"], sample["z"]))
        data += bytes(layout["row_padding"])
    datatype = {"d": PointField.FLOAT64, "f": PointField.FLOAT32}
    cloud = PointCloud2(
        height=layout["height"],
        width=layout["width"],
        fields=[PointField(name=n, offset=offsets[n], datatype=datatype[form[n]], count=1) for n in names],
        is_bigendian=layout["big"],
        point_step=step,
        row_step=step * layout["width"] + layout["row_padding"],
    )
    cloud.data.frombytes(bytes(data))
    x, z = point_cloud.samples_of(cloud)
    assert list(zip(x.tolist(), z.tolist(), strict=True)) == expected


U32 = st.one_of(st.integers(0, 40), st.sampled_from([2**16, MAX_SAMPLES + 1, 2**31 - 1, 2**31, 2**32 - 1]))


@settings(deadline=None, max_examples=300)
@given(
    st.builds(
        dict,
        height=U32,
        width=U32,
        point_step=U32,
        row_step=U32,
        is_bigendian=st.booleans(),
        size=st.integers(0, 400),
        fields=st.lists(
            st.builds(
                lambda **fields: PointField(**fields),
                name=st.sampled_from(["x", "z", "", "intensity"]),
                offset=U32,
                datatype=st.integers(0, 255),
                count=U32,
            )
            | st.sampled_from([PointField(name=n, datatype=7, count=1, offset=o) for n in "xz" for o in (0, 4)]),
            max_size=4,
        ),
    )
)
def test_sizes_that_do_not_fit_are_refused_and_nothing_else_happens(form: dict[str, Any]) -> None:
    cloud = PointCloud2(**{name: value for name, value in form.items() if name != "size"})
    cloud.data.frombytes(bytes(form["size"]))
    with suppress(MessageError):
        x, z = point_cloud.samples_of(cloud)
        assert len(x) == len(z) == form["height"] * form["width"]


def test_damaged_bytes_of_a_cloud_are_refused(
    spinning: Callable[..., Any], folder: Path, publisher: Callable[..., Any]
) -> None:
    listening = spinning(Listening, folder=str(folder))
    publish = publisher("rail_surface_points", PointCloud2)
    x = np.arange(1000) * 1e-3
    whole = serialize_message(point_cloud.cloud_of(x, np.zeros(1000)))
    generator = np.random.default_rng(1)
    for _ in range(50):
        publish(whole[: generator.integers(4, len(whole) // 2)])
    publish(whole)
    wait_until(lambda: listening.topics.diagnostics.received["rail_surface_points"] == 51)
    wait_until(lambda: listening.trolley.facts().get("trolley at m") == "0.997")
    assert listening.trolley.facts()["point clouds refused"] == 50


def test_chainages_that_float32_cannot_tell_apart_are_complained_of() -> None:
    fields = [PointField(name=n, datatype=PointField.FLOAT32, count=1, offset=o) for n, o in (("x", 0), ("z", 4))]
    cloud = PointCloud2(height=1, width=1, fields=fields, point_step=8, row_step=8)
    cloud.data.frombytes(struct.pack("<ff", 12_345.678, 0.0))
    x, _ = point_cloud.samples_of(cloud)
    assert point_cloud.coarseness_m(cloud, x) == 2.0**-10  # 24 bits of a number between 2^13 and 2^14
    assert point_cloud.coarseness_m(point_cloud.cloud_of(x, x), x) == 0.0


@pytest.mark.parametrize(("text", "read"), [("", UNSET), ("with", "with"), ("both", "both")])
def test_how_trains_run_is_read_from_the_parameter(text: str, read: object) -> None:
    assert trolley_input._running(text) == read


def test_a_direction_of_trains_that_is_none_is_refused_in_one_line() -> None:
    with pytest.raises(InputError, match=r"^running 'uphill' is unknown; use with, against or both"):
        trolley_input._running("uphill")


def test_what_the_stream_says_of_trains_stands_in_the_capture(spinning: Callable[..., Any], folder: Path) -> None:
    listening = spinning(Listening, folder=str(folder), running="both")
    x = np.round(np.arange(0.0, 2.0, 1e-3), 6)
    form = {"chainage_unit": "m", "height_unit": "um", "height_positive": "up"}
    batch = RailSurface(chainage=x.tolist(), height=(np.sin(x * 30) * 50).tolist(), running="against", **form)
    listening.trolley._live.mark(WeldMarker(chainage_m=1.0))
    listening.trolley._live.push(decode(RailSurface, encode(batch)))
    listening.trolley._live.finish()
    (file,) = files(folder)
    assert read_profile(file).running == "against"


def test_the_example_driver_makes_a_file_of_the_weld_at_the_button(
    spinning: Callable[..., Any], folder: Path, domain_id: int
) -> None:
    """In a process of its own that knows nothing of the suite, fed by lines as a serial port gives them."""
    spinning(Listening, folder=str(folder))
    at_m = np.arange(0, 3000) * 1e-3
    height_um = -200 * np.exp(-(((at_m - 1.5) / 0.03) ** 2))
    lines = [f"{12_000 + x:.3f},{z:.1f}" for x, z in zip(at_m, height_um, strict=True)]
    lines.insert(1501, "weld KM12-L-004")
    driver = subprocess.run(
        [sys.executable, str(EXAMPLE)], input="\n".join(lines), text=True, capture_output=True, timeout=DEADLINE_S
    )
    assert driver.returncode == 0, driver.stderr
    wait_until(lambda: list(folder.glob("*.csv")))
    (file,) = folder.glob("*.csv")
    weld = read_profile(file)
    assert weld.weld_id == "KM12-L-004"
    assert weld.chainage_m == pytest.approx(12_001.5, abs=5e-3)
    assert min(weld.z_m) == pytest.approx(-200e-6, abs=10e-6)
