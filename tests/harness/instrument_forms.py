"""Files as instruments and people write them, each after a public description, and what is to come of them.

One weld everywhere, a cosine dip of 0.40 mm over 300 mm, from -600 to 600 mm every 5 mm unless the form asks otherwise.
"Layout assumed" marks forms of which quantities are public and the arrangement of the file is not.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

X_MM = list(range(-600, 601, 5))
RAITA = "github.com/finnishtransportagency/raita csvDataParser.test.ts"
CONTACT = "github.com/eve70a/CONTACT"
PROFILOMETER = "github.com/jonathan-bender/scaling-octo-telegram README.md"


def dip_um(x_mm: float) -> float:
    """Height of the weld."""
    return -200.0 * (1 + math.cos(2 * math.pi * x_mm / 300.0)) if abs(x_mm) <= 150 else 0.0


@dataclass(frozen=True)
class Form:
    """A file in one form.

    Attributes:
        name: of the file.
        data: its bytes.
        source: of the form's description.
        refused: what the refusal says; empty if the file is read.
        stated: what the user states beside the file.
        welds: depth of each weld in the file, 1 for 0.40 mm.
        within_um: of the true heights.
        note: what the profile says was done.
        reach_m: the record goes from - to + this.
    """

    name: str
    data: bytes
    source: str
    refused: str = ""
    stated: dict[str, Any] = field(default_factory=dict)
    welds: tuple[float, ...] = (1.0,)
    within_um: float = 0.6
    note: str = ""
    reach_m: tuple[float, float] = (-0.6, 0.6)


FORMS: list[Form] = []


def add(name: str, data: str | bytes, source: str, **expected: Any) -> None:
    FORMS.append(Form(name, data.encode() if isinstance(data, str) else data, source, **expected))


def fixed(value: float, digits: int, decimal: str = ".") -> str:
    """Return a number without a negative zero."""
    return f"{round(value, digits) + 0.0:.{digits}f}".replace(".", decimal)


def whole(x: float) -> str:
    return str(x)


def mm(z_um: float) -> str:
    return fixed(z_um / 1000, 3)


def mm_comma(z_um: float) -> str:
    return fixed(z_um / 1000, 3, ",")


def um_comma(z_um: float) -> str:
    return fixed(z_um, 1, ",")


def um(z_um: float) -> str:
    return fixed(z_um, 1)


def grouped(value: float, digits: int, group: str, decimal: str = ".") -> str:
    text = f"{round(value, digits) + 0.0:,.{digits}f}"
    return text.replace(",", "G").replace(".", decimal).replace("G", group)


def table(
    separator: str,
    heading: str | Sequence[str] = (),
    *,
    x: Callable[[float], str] = whole,
    z: Callable[[float], str] = mm,
    places: Iterable[float] = X_MM,
    depth: float = 1.0,
    end: str = "\n",
    behind: str = "",
) -> str:
    """Return rows of x and z below their heading."""
    head = [heading] if isinstance(heading, str) else list(heading)
    rows = [f"{x(place)}{separator}{z(dip_um(place) * depth)}{behind}" for place in places]
    return end.join([*head, *rows]) + end


def semicolons(heading: str | Sequence[str] = "x_mm;z_mm", **how: Any) -> str:
    return table(";", heading, **({"z": mm_comma} | how))


# Separators, decimal marks, line ends

add("semicolon-comma.csv", semicolons("Weg [mm];Höhe [mm]"), "polars#6698, numpy#13810, csvlint.io#171")
add("tab-comma.txt", table("\t", x=lambda x: fixed(x, 1, ","), z=mm_comma), "nodebox#80, nyetwurk/ecuxplot#14")
add("sep-line.csv", semicolons(["sep=;", "x_mm;z_mm"], end="\r\n"), "zimmerman-team/IATI.cloud#1622, ag-grid#455")
add("carriage-returns.csv", semicolons(end="\r"), "measurement.md, right today")
add("cr-cr-lf.csv", semicolons(end="\r\r\n"), "delmic/odemis#1814, spinalcordtoolbox#3713")
add("trailing-separator.csv", semicolons("x_mm;z_mm;", behind=";"), "numpy#21052")
add("trailing-in-rows-only.csv", semicolons(behind=";;"), "benwbrum/fromthepage#2273 (53 against 113 cells)")
add("blank-padded.csv", table(" , ", " x_mm , z_mm", x=lambda x: f"  {x}"), "firemodels/fds#733")
add(
    "bars.txt", "| x_mm | z_mm |\n|-----:|-----:|\n" + table(" | ", x=lambda x: f"| {x}", behind=" |"), "psql, Markdown"
)
add(
    "comma-twice.csv",
    table(",", x=lambda x: fixed(x, 1, ","), z=mm_comma),
    "Data-Liberation-Front/csvlint.io#171",
    refused="semicolons between the columns",
)
add(
    "comma-and-blank.csv",
    table(", ", "x, z", x=lambda x: fixed(x, 1, ","), z=mm_comma),
    "firemodels/fds#733 (blank before each value); the decimal comma is ours",
    refused="4 columns, but the heading names 2",
)
add(
    "quoted-decimal-comma.csv",
    table(",", "x,z", z=lambda z: f'"{mm_comma(z)}"'),
    'wireservice/csvkit#876 ("2523,00" read as 252300)',
)
add(
    "fixed-width-glued.txt",
    table("", "     X(MM)     Z(UM)", x=lambda x: f"{x:10.1f}", z=lambda z: f"{fixed(z, 3):>8}"),
    "cp-paw/cp-paw#2 (5.79225-117.40171), geodynamics/aspect#1334",
)

# Encodings

add(
    "utf-16-tab.txt",
    table("\t", "Weg (mm)\tHöhe (mm)", z=mm_comma, end="\r\n").encode("utf-16"),
    "data-manager-app#588",
)
add("utf-16-unmarked.txt", table("\t", "x_mm\tz_mm").encode("utf-16-le"), "SheetJS/sheetjs#575; unmarked is ours")
add("utf-16-named.xlsx", table("\t", "x_mm\tz_mm").encode("utf-16"), "SheetJS/sheetjs#575")
add("utf-8-marked.csv", semicolons().encode("utf-8-sig"), "swisstopo/swissgeol-boreholes-suite#3024")
add(
    "windows-1252.csv",
    semicolons("Position [mm];Höhe [µm]", z=um_comma, end="\r\n").encode("cp1252"),
    "swisstopo/swissgeol-boreholes-suite#3024, polars#9280",
    note="not UTF-8: read as cp1252",
)
add(
    "two-encodings.csv",
    "# Prüfer: Mayer\n".encode() + "# Ort: Köln\n".encode("cp1252") + table(",", "x_mm,z_mm").encode(),
    "Knowledge-Graph-Hub/kg-microbe#649, w3c/csvw#699",
)
add(
    "stray-byte.csv",
    b"x(mm),temp(\xc4C),z(mm)\n" + table(",21.5,").encode(),
    "FrSkyRC/ETHOS-Feedback-Community#2743",
    note="columns not used: temp",
)
add("ctrl-z-and-zeros.csv", table(",", "x_mm,z_mm", end="\r\n").encode() + b"\x1a" + b"\0" * 512, "datatable#590")

# Header blocks, headings, footers

add(
    "key-value-block.csv",
    semicolons(
        [
            *("Gerät;ESL-1200", "Seriennummer;0417", "Datum;13.05.2024", "Uhrzeit;10:31:07", "Bediener;Mayer"),
            *("Schweißung;W 12", "Messlänge [mm];1200", "Schrittweite [mm];5", "", "Weg [mm];Höhe [mm]"),
        ],
        end="\r\n",
    ).encode("cp1252"),
    "PlotJuggler#734, mholt/PapaParse#794",
)
add(
    "tilde-header.txt",
    table("\t1\t", ["~Result of a straightedge", "~Date: 10.11.2022", "~", "~x[mm]\tDataSet\tz[mm]"]),
    "BdR76/CSVLint#46 (Basytec)",
    note="columns not used: DataSet",
)
add(
    "nb-header-lines.txt",
    table("\t", ["ASCII FILE", "Nb header lines : 5", "", "Limits : -10.00 mm", "x/mm\tz/mm"], z=mm_comma),
    "echemdata/galvani#82 (EC-Lab)",
)
add(
    "sections.txt",
    "[Header]\nDate=2024-05-13\nUnitX=mm\nUnitZ=um\nCount=241\n[Data]\n" + table("\t", z=um) + "[End]\n",
    f"{CONTACT} testbank/profiles/SNX00500.mpt has this build",
    note="1 line after the samples",
)
add(
    "sections-cut.txt",
    "[Header]\nUnitX=mm\nUnitZ=um\nCount=300\n[Data]\n" + table("\t", z=um),
    f"{CONTACT} (XYPoints=), ours",
    refused="300 samples announced, 241 are there",
)
add(
    "toa5.dat",
    '"TOA5","6843","CR3000"\n"TIMESTAMP","RECORD","x","z"\n"TS","RN","mm","um"\n"","","Smp","Smp"\n'
    + table(",", x=lambda x: f'"2012-06-07 13:00:00",{111868400 + x},{x}', z=um),
    "elixir-explorer/explorer#781, #782 (Campbell TOA5)",
    note="columns not used: TIMESTAMP, RECORD",
)
add("units-row.csv", table(",", ["x,z", "mm,um"], z=um), "tidyverse/readr#179, pandas#10898")
add("separator-rows.csv", semicolons([" ;", ";", "Weg;Höhe", "mm;mm", ";"], end="\r\n"), "pandas#10898")
add(
    "footer.csv",
    semicolons() + "\nMax;0,000\nMin;-0,400\nQI;1,06\nEnde der Messung\n",
    "jpshanno/ingestr#19 (rows of mean and deviation)",
    note="4 lines after the samples",
)
STATEMENTS = ["# x_unit: mm", "# z_unit: mm", "# z_positive: up"]
add(
    "padded-statements.csv", semicolons([*(f"{s};;" for s in STATEMENTS), "x;z;"], behind=";"), "fds#379, DataBasic#176"
)
add("quoted-statements.csv", table(",", [*(f'"{s}"' for s in STATEMENTS), "x,z"]), "py_midicsv#17")
add(
    "heading-repeated.csv",
    table(",", "x_mm,z_mm", places=X_MM[:120]) + table(",", "x_mm,z_mm", places=X_MM[120:]),
    "gpslogger#529",
)
add(
    "percent-comments.txt",
    table(" ", ["% Weld 12, x [mm], z [mm]", "! measured 2024-05-13"]).replace("\n0 -0.400", "\n0 -0.400 ! joint"),
    f"{CONTACT} matlab/read_miniprof.m (comments after quotes, !, %)",
)
add(
    "jcamp.jdx",
    "##TITLE=Weld 12\n##JCAMP-DX=4.24\n##XUNITS=MM\n##YUNITS=MICROMETERS\n##NPOINTS=241\n##XYPOINTS=(XY..XY)\n"
    + table(", ", z=lambda z: fixed(z, 6))
    + "##END=\n",
    "nzhagen/jcamp#16",
)
add(
    "yaml-front.csv",
    "---\nname: Weld 12\nfields:\n- {name: x, unit: mm}\n- {name: z, unit: mm}\n---\n" + table(",", "x,z"),
    "csvy/csvy.github.io#4",
)
add(
    "channel-rows.txt",
    "# channel-id:  usi9706     channel-id:  usi9707\n# name:        Weg         name:        Hoehe\n"
    "# unit:        mm          unit:        um\n" + table("     ", z=lambda z: fixed(z, 3)),
    "RecordEvolution/TDMtermite#4",
    stated={"z_unit": "um"},
)
add(
    "time-first.csv",
    semicolons("time;x_mm;z_mm;ok", x=lambda x: f"2024-05-13 10:31:00;{x}", behind=";TRUE"),
    "elixir-explorer/explorer#781, apama-log-analyzer#5",
    note="columns not used: time, ok",
)

# Numbers and units

add(
    "thousands-point.csv",
    semicolons("x_um;z_nm", x=lambda x: grouped(x * 1000, 0, "."), z=lambda z: grouped(z * 1000, 0, ".")),
    "ngrunwald/meta-csv#5, SheetJS#2221",
    refused="the record is 1.2 mm long",
)
add(
    "thousands-comma-quoted.csv",
    table(
        ",",
        '"x [um]","z [um]"',
        x=lambda x: f'"{grouped(x * 1000, 1, ",")}"',
        z=lambda z: f'"{grouped(z, 1, ",")}"',
    ),
    "SheetJS/ssf#43",
)
add("apostrophes.csv", semicolons("x [um];z [um]", x=lambda x: grouped(x * 1000, 0, "'"), z=um), "Swiss Excel")
add("unicode-minus.csv", semicolons().replace("-", "\u2212"), "polars#28163, actual#6206")
add("plus-signs.txt", table("\t", x=lambda x: f"{x:+d}", z=lambda z: f"{z / 1000 + 0.0:+.3f}"), PROFILOMETER)
add(
    "fortran-d.txt",
    table(" ", x=lambda x: f"  {x / 1000:.6E}".replace("E", "D"), z=lambda z: f"{z / 1e6:.6E}".replace("E", "D")),
    "firemodels/fds#733; the D is ours",
    stated={"x_unit": "m", "z_unit": "m"},
)
add(
    "exponent-comma.txt",
    table("\t", x=lambda x: f"{x / 1000:.4e}", z=lambda z: f"{z / 1e6:.4e}").replace(".", ","),
    "LabVIEW in a German locale",
    stated={"x_unit": "m", "z_unit": "m"},
)
add("inch-mil.csv", table(",", "x [in],z [mil]", x=lambda x: f"{x / 25.4:.4f}", z=lambda z: f"{z / 25.4:.2f}"),
    "submersion#1813, knipknap/better-tool-library#42")  # fmt: skip
add("hundredths.txt", table("\t", "x [mm]\tz [1/100 mm]", z=lambda z: fixed(z / 10, 0)), "rank 16", within_um=5.1)
add("x-in-m.csv", semicolons("x [m];z [mm]", x=lambda x: fixed(x / 1000, 3, ",")), "gensys trc_* manuals")
add(
    "unit-contradicted.csv",
    table(",", "x (mm),z (mm)", x=lambda x: fixed(x / 1000, 3), z=lambda z: fixed(z / 1e6, 7)),
    "firemodels/fds#1410",
    refused="the record is 1.2 mm long",
)
add(
    "unit-column.csv",
    table(",", "x_mm,z,unit", behind=",mm"),
    "webspiderteam/Bluetooth-DMM-For-Windows#13; one unit is ours",
    stated={"z_unit": None},
)
add(
    "autorange.csv",
    table(",", "x_mm,z,unit", z=lambda z: f"{mm(z)},mm" if abs(z) >= 100 else f"{um(z)},um"),
    "webspiderteam/Bluetooth-DMM-For-Windows#13 (mV/V)",
    refused="the unit in column 'unit' changes",
)
add(
    "units-in-cells.csv",
    semicolons("Weg;Höhe", x=lambda x: f"{x} mm", z=lambda z: f"{um_comma(z)} µm"),
    "webspiderteam/Bluetooth-DMM-For-Windows#13",
    refused="no samples",
)

# Missing values

for _name, _mark in {
    "dashes": "---", "finnish": "epäluku", "infinity": "∞", "bad": "Bad", "empty": "", "hash": "#N/A",
    "overload": "OL", "minus-9999": "-9999", "full-scale": "9,999",
}.items():  # fmt: skip
    _text = semicolons().replace("\n200;0,000", f"\n200;{_mark}").replace("\n-300;0,000", f"\n-300;{_mark}")
    _source = f"{RAITA}; SurfaceTopography#399, oce#983, earthlens#1047, t400-firmware#154, chrisbra/csv.vim#64"
    add(f"missing-{_name}.csv", _text, _source, note="2 missing heights put by a cubic")
