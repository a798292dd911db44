"""Know columns by the words in their headings: positions, heights up or down, what is no height; and units in them."""

import re
import unicodedata

from weld_force_ros.measurement.numbers import unit_of

POSITIONS = {"x", "s", "pos", "position", "weg", "abstand", "distanz", "distance", "dist", "length", "lange", "laenge",
      "location", "chainage", "station", "stationierung", "kilometer", "km", "afstand", "strecke"}  # fmt: skip
HEIGHTS_UP = {"hohe", "hoehe", "height", "heights", "elevation", "hauteur", "hoogte", "altitude", "level"}
HEIGHTS_DOWN = {"gap", "spalt", "depth", "tiefe", "diepte"}
HEIGHTS = {"z", "vert", "vertical", "vertikal", "laufflache", "fahrflache", "running", "surface", "profile", "profil",
      "basic", "deviation"} | HEIGHTS_UP | HEIGHTS_DOWN  # fmt: skip
ASIDE = {"hor", "horizontal", "lateral", "seitlich", "seite", "side", "gauge", "gage", "fahrkante", "waviness",
          "trend", "mean", "mittel", "mittelwert", "welligkeit"}  # fmt: skip
NO_HEIGHTS = {
    "rms": "RMS values, not heights",
    "db": "levels, not heights",
    "versine": "versines, not heights",
    "versines": "versines, not heights",
    "pfeilhohe": "versines, not heights",
    "pfeilhoehe": "versines, not heights",
    "wavelength": "a spectrum, not heights",
    "wellenlange": "a spectrum, not heights",
}
WELDS = {"weld", "joint", "schweissung", "schweissstoss", "stoss", "las", "lasnummer"}
COUNTERS = {"nr", "no", "index", "counter", "sample", "punkt", "point", "record"}


def words_of(name: str) -> set[str]:
    """Return the words of a column's name: lower case, without accents and unit."""
    plain = unicodedata.normalize("NFKD", without_unit(name).casefold())
    plain = "".join(c for c in plain if not unicodedata.combining(c))
    return set(re.findall(r"[a-z]+", plain))


def without_unit(name: str) -> str:
    """Return a column's name without the unit behind it."""
    plain = re.sub(r"[\[(<{/].*$", "", name).strip() or name
    before, _, last = plain.rpartition("_")
    return before if before and unit_of(last) else plain


def unit_in(name: str) -> str | None:
    """Return the unit that a column's name holds: `z [mm]`, `Höhe (µm)`, `x_mm`, `km`."""
    if name.strip().casefold() == "km":
        return "km"
    for pattern in (r"[\[(<{]([^\])>}]*)[\])>}]", r"[_/\s]([^\s_]+)$"):
        if (found := re.search(pattern, name)) and (unit := unit_of(found[1])):
            return unit
    return None
