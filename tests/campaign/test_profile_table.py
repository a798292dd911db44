"""Tables of welds: what a measurement says beside its geometry comes back."""

from pathlib import Path

from msgspec.structs import replace

from weld_force_ros.campaign import profile_table
from weld_force_ros.measurement.profile_file import shipped_profile
from weld_force_ros.messages import FormError, MeasurementNoise, parse_support


def test_form_error_and_chainage_direction_come_back(tmp_path: Path) -> None:
    plain = shipped_profile("weld-1-dip")
    error = FormError(deviation_m=2e-5, length_m=0.5, source="its certificate")
    noise = MeasurementNoise(method="adaptive spline", noise_m=3e-6, form_error=error)
    full = replace(plain, noise=noise, chainage_direction="against")
    profile_table.write(tmp_path / "welds.parquet", [plain, full])
    back = list(profile_table.read(tmp_path / "welds.parquet", 0, 2))
    assert [weld.noise for weld in back] == [plain.noise, noise]
    assert [weld.chainage_direction for weld in back] == [plain.chainage_direction, "against"]


def test_support_comes_back_and_none_stated_is_not_none_differing(tmp_path: Path) -> None:
    plain = shipped_profile("weld-1-dip")
    stated = [plain.support, [], parse_support("-1=missing,0=0.02,1=gap:0.8mm,2=pad:2")]
    profile_table.write(tmp_path / "welds.parquet", [replace(plain, support=support) for support in stated])
    assert [weld.support for weld in profile_table.read(tmp_path / "welds.parquet", 0, 3)] == stated
