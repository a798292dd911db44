"""Fix what a campaign will do before it begins: kept beside the results, as a resumed run must do the same."""

import hashlib
from pathlib import Path

import msgspec

from weld_force_ros import SOFTWARE, _files
from weld_force_ros.campaign.campaign_file import Campaign, NetworkSection
from weld_force_ros.campaign.sources import Source
from weld_force_ros.errors import InputError, os_errors_as
from weld_force_ros.messages import AssessmentSettings

_FILE = "plan.json"

LAYOUT = 2
"""How results are laid out in their folder; 1 had a row of verdicts for every vehicle over a weld."""


class Plan(msgspec.Struct, frozen=True):
    """All that the results depend on; plans that name no layout are of the first."""

    software: str
    name: str
    sources: list[Source]
    sections: list[NetworkSection]
    limits: AssessmentSettings
    batch_welds: int
    layout: int = 1

    @property
    def welds(self) -> int:
        """Number of welds of all sources."""
        return sum(source.welds for source in self.sources)

    @property
    def batches(self) -> int:
        """Number of batches."""
        return -(-self.welds // self.batch_welds)

    @property
    def vehicles(self) -> int:
        """Largest number of vehicles over one weld."""
        return max(len(section.vehicles) for section in self.sections)

    @property
    def passages(self) -> int:
        """Largest number of passages over one weld."""
        return max(
            sum(len(settings.speeds_kmh) * len(settings.positions_m) for settings in section.vehicles.values())
            for section in self.sections
        )

    @property
    def sha256(self) -> str:
        """Identity of the plan."""
        return hashlib.sha256(msgspec.json.encode(self, order="sorted")).hexdigest()


def make(campaign: Campaign, sources: list[Source]) -> Plan:
    """Return the plan of a campaign over its sources."""
    return Plan(SOFTWARE, campaign.name, sources, campaign.sections, campaign.limits, campaign.batch_welds, LAYOUT)


def claim_folder(plan: Plan, out: Path) -> bool:
    """Make `out` the folder of this plan's results; return whether it was already.

    Raises:
        InputError: other results are there, or the folder cannot be written.
    """
    try:
        there = load(out)
    except FileNotFoundError:
        with os_errors_as(InputError, out, "give --out a writable folder"):
            _files.write_whole(out / _FILE, msgspec.json.format(msgspec.json.encode(plan)))
        return False
    if there.sha256 != plan.sha256:
        names = [name for name in Plan.__struct_fields__ if getattr(there, name) != getattr(plan, name)]
        raise InputError(
            f"{out} holds the results of another campaign, or of other sources (other {', '.join(names)})",
            "give another --out, or remove that folder",
        )
    return True


def load(out: Path) -> Plan:
    """Return the plan whose results are in a folder.

    Raises:
        FileNotFoundError: there is none.
        InputError: it cannot be read, or the results are laid out as another version did.
    """
    try:
        plan = msgspec.json.decode((out / _FILE).read_bytes(), type=Plan)
    except (FileNotFoundError, NotADirectoryError):
        raise FileNotFoundError(out / _FILE) from None
    except (OSError, msgspec.DecodeError) as error:
        raise InputError(f"{out / _FILE}: {error}", "remove that folder, or give another --out") from None
    if plan.layout != LAYOUT:
        raise InputError(
            f"{out} holds results that {plan.software} laid out otherwise than one decision a weld",
            "run the campaign again into another folder (--out)",
        )
    return plan


def results(out: Path) -> Plan:
    """Return the plan whose results are to be evaluated.

    Raises:
        InputError: no campaign was run there.
    """
    try:
        return load(out)
    except FileNotFoundError:
        raise InputError(
            f"{out} holds no results of a campaign", "name the folder that `weld-force campaign` wrote"
        ) from None
