"""Declare what comes from the trolley, and how nodes agree on which measurements are finished."""

from typing import Annotated

from msgspec import UNSET, Meta, UnsetType

from weld_force_ros.messages.fields import (
    MAX_TEXT,
    Batch,
    ChainageM,
    LengthUnit,
    Message,
    Name,
    Number,
    ProfileId,
    ProfileIds,
    Running,
    Sha256,
    SpeedKmh,
    Text,
    UpOrDown,
)


class Rejection(Message, kw_only=True):
    """An input that could not be used, with what to do about it; the text it came as is kept."""

    source: Name
    reason: Text
    remedy: Text
    raw_text: Annotated[str, Meta(max_length=MAX_TEXT)] = ""
    raw_truncated: bool = False
    source_sha256: Sha256 | UnsetType = UNSET
    profile_sha256: Sha256 | UnsetType = UNSET
    profile_id: ProfileId | UnsetType = UNSET
    file_version_of: (
        Annotated[Name, Meta(description="the file that was refused: of its outcomes the last counts")] | UnsetType
    ) = UNSET


class RailSurface(Message, kw_only=True):
    """A batch of running-surface samples in the order measured; batches may overlap, and the trolley may reverse.

    `running` says how trains run over this rail, whichever way it is measured: with, the way in which chainage rises.
    Where a batch does not say it, what the last one said that did holds.
    """

    chainage: Batch
    height: Batch
    chainage_unit: LengthUnit
    height_unit: LengthUnit
    height_positive: UpOrDown
    running: Running | UnsetType = UNSET

    def problem(self) -> str | None:
        """Return that chainages and heights differ in number; else None."""
        if len(self.chainage) == len(self.height):
            return None
        return f"{len(self.chainage)} chainages but {len(self.height)} heights"


class WeldMarker(Message, kw_only=True):
    """A weld's place: at `chainage_m`, or where the trolley is now; what is known of it goes into its profile."""

    chainage_m: ChainageM | UnsetType = UNSET
    weld_id: Name | UnsetType = UNSET
    line_speed_kmh: SpeedKmh | UnsetType = UNSET
    weld_position_m: (
        Annotated[float, Meta(description="m of the weld's centre after the preceding sleeper", ge=0.0)] | UnsetType
    ) = UNSET


class Inquiry(Message, kw_only=True):
    """A question which of these measurements have their verdict or rejection, answered on `settled`."""

    profile_ids: ProfileIds


class Settled(Message, kw_only=True):
    """Measurements whose verdict or rejection is recorded and published.

    The assessment node says so of each as it comes; asked by an Inquiry, it names those that have (perhaps none).
    """

    profile_ids: ProfileIds
    asked_by: Annotated[str, Meta(max_length=300, description="publisher of the inquiry; empty: not asked")] = ""
    asked_sequence: Number = 0
