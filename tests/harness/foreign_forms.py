"""Further forms of files: of vendors, of several welds or columns, of positions, archives, and files that are cut."""

import gzip
import io
import zipfile

import openpyxl

from tests.harness.instrument_forms import (
    CONTACT,
    FORMS,
    PROFILOMETER,
    RAITA,
    X_MM,
    Form,
    add,
    dip_um,
    fixed,
    mm,
    mm_comma,
    semicolons,
    table,
    um,
)


def workbook(*sheets: tuple[str, list[list[object]]]) -> bytes:
    book, stream = openpyxl.Workbook(), io.BytesIO()
    book.remove(book.active)
    for title, rows in sheets:
        sheet = book.create_sheet(title)
        for row in rows:
            sheet.append(row)
    book.save(stream)
    return stream.getvalue()


def archive(**files: str) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as file:
        for name, text in files.items():
            file.writestr(name, text)
    return stream.getvalue()


HUNDREDTHS_MM = 5.1  # um
FINE_MM = range(-600, 601)

# Vendors

add(
    "railprof.txt",
    table("\t", "x\tvert\thor", z=lambda z: fixed(z / 1000, 2), behind="\t0.01", end="\r\n"),
    "esveld.com/Railprof.html (quantities); layout as users report it",
    within_um=HUNDREDTHS_MM,
    note="columns not used: hor",
    stated={"x_unit": None, "z_unit": None, "z_positive": None},
)
_basic = [dip_um(x) for x in X_MM]
_trend = [sum(part) / len(part) for i in range(len(X_MM)) for part in [_basic[max(0, i - 20) : i + 21]]]
add(
    "graw-series.csv",
    "Graw RSG (layout assumed)\nx [mm];Basic profile [mm];Trend [mm];Waviness [mm]\n"
    + "".join(
        f"{x};" + ";".join(fixed(v / 1000, 2, ",") for v in (z, t, z - t)) + "\n"
        for x, z, t in zip(X_MM, _basic, _trend, strict=True)
    ),
    "graw.com/RSG_measurement-example_en.htm; layout assumed",
    within_um=HUNDREDTHS_MM,
    note="columns not used: Trend [mm], Waviness [mm]",
)
add(
    "graw-report.txt",
    "Weld no. 12   Date 2024-05-13   Vertical plane\r\n        value   limit  emergency\r\n"
    "Max    +0.52    0.20   0.40   *\r\nMin    -0.10    0.20   0.40\r\n",
    "graw.com/RSG_measurement-example_en.htm; layout assumed",
    refused="no samples",
)
_across = "".join(f"{k / 2:.4f} {-(k * k) / 2400:.4f} 0.0000 0 \n" for k in range(-70, 71))
add(
    "miniprof.ban",
    "Filename=section_12.ban\nMPTypeNo=299\nXYPoints=141\nColumnDef=X,Y,A,C\n\n" + _across,
    f"{CONTACT} examples/MBench_UIC60_v3.ban, matlab/read_miniprof.m",
    refused="cross section",
)
add(
    "miniprof-old.whl",
    "#MINIWHEELPROF\nCar7216_0001_T(R).whl\nStock.......:\n 32.58 37.11 14.71\n(Sd/Sh/qR)\n\n" + _across,
    f"{CONTACT} testbank/profiles/Car7216_0001r.whl",
    refused="cross section",
)
add(
    "miniprof.mpt",
    "[FileInfo]\nProgramVer=2.43.74\n\n[Profile1Info]\nXYPoints=141\n\n[Profile1Points]\n" + _across,
    f"{CONTACT} testbank/profiles/SNX00500.mpt",
    refused="cross section",
)
add(
    "slices.slcs",
    "% data for rail with one weld\n   3                NSLC\n -100.0      'p_1.prr'\n    0.0      'p_2.prr'\n",
    f"{CONTACT} testbank/profiles/cross_nose.slcs",
    refused="no samples",
)
add(
    "rms-of-bands.csv",
    '"Running Date";"5/5/2022 8:47:01 AM"\n'
    '"SSCount";"Location [km+m]";"Rail Corrugation.Oikea Raiteen Aallon RMS [10-30]mm [µm]"\n'
    + "".join(f"{i + 1};185+{400 + 0.25 * i:07.2f};{2.1 + 0.01 * i:.4f}\n" for i in range(40)),
    RAITA,
    refused="RMS values",
)
_counted = "Counter\tAltitude (µm)\tEncoder1 (µm)\tRow number\r\n" + "".join(
    f"{37 + i}\t{fixed(623.381 + z, 4)}\t-1.4\t1\r\n" for i, z in enumerate(_basic)
)
add("profilometer.txt", _counted.encode("cp1252"), PROFILOMETER, stated={"spacing": 5.0})
add("profilometer-unstated.txt", _counted.encode("cp1252"), PROFILOMETER, refused="x is a counter: state the spacing")
add(
    "profilometer-parameters.txt",
    "Pen: 1000 µ\r\nFrequency = 400 Hz\r\nX step distance = 5.000 mm\r\nNumber of rows = 1\r\n".encode("cp1252"),
    PROFILOMETER,
    refused="no samples",
)
_data: list[list[object]] = [["", None, None, None, (i + 1) * 5.0, round(z, 3)] for i, z in enumerate(_basic)]
for _i, _text in enumerate(("Ra 0.078 µm", "Rq 0.096 µm", "Rz 0.392 µm")):
    _data[_i][0] = _text
_mitutoyo = workbook(("Certificate", [["", "", "", "", "26-Jul-2020"]]), ("DATA", _data))
MITUTOYO = "github.com/ContactEngineering/SurfaceTopography IO/Mitutoyo.py"
add("mitutoyo-unstated.xlsx", _mitutoyo, MITUTOYO, refused="columns: {x: 1, z: 2}")
add("mitutoyo.xlsx", _mitutoyo, MITUTOYO, stated={"columns": {"x": 5, "z": 6}, "z_unit": "um"}, note="sheet 'DATA'")
add(
    "cat.txt",
    table(
        "\t",
        "distance (m)\tdisplacement (um)",
        x=lambda x: f"{12.0 + (x + 600) / 1000:.3f}",
        z=lambda z: fixed(z, 2),
        places=FINE_MM,
    ),
    "railmeasurement.com/features.htm (1 mm, 0.01 um); layout assumed",
)
add(
    "roughness.txt",
    "".join(f"{fixed(dip_um(x), 3)}\n" for x in FINE_MM),
    "jmrplens/phonometry (EN 15610: at most 1 mm, no file prescribed)",
    stated={"spacing": 1.0, "z_unit": "um"},
)
add(
    "spectrum.csv",
    "wavelength_cm;Lr_dB\n" + "".join(f"{100 / 1.26**i:.1f};{12 - i}\n".replace(".", ",") for i in range(15)),
    "github.com/mic-haf/SDWirkungNi SR_Ni.Rmd",
    refused="a spectrum, not heights",
)

# Several welds, passes, rails

add(
    "weld-column.csv",
    "weld;x_mm;z_mm\n" + "".join(semicolons((), x=lambda x, k=k: f"W{k};{x}", depth=1 / k) for k in (1, 2)),
    "measurement.md, rank 11",
    welds=(1.0, 0.5),
)
add(
    "weld-blocks.txt",
    "\n\n".join(f"Weld {k}\nDate: 2024-05-1{k}\n" + table("\t", "x (mm)\tz (mm)", depth=1 / k) for k in (1, 2)),
    "echemdata/galvani#28, jpshanno/ingestr#19, nzhagen/jcamp#16",
    welds=(1.0, 0.5),
)
add(
    "comma-line-blocks.csv",
    ",,\n,,\n".join(f"Weld,{k},\n" + table(",", "x_mm,z_mm,", depth=1 / k, behind=",") for k in (1, 2)),
    "Benchling-Open-Source/allotropy#742",
    welds=(1.0, 0.5),
)
_passes = "x_mm;pass 1;pass 2;pass 3;mean\n" + "".join(
    f"{x};{mm_comma(z + 3)};{mm_comma(z - 3)};{mm_comma(z)};{mm_comma(z)}\n" for x, z in zip(X_MM, _basic, strict=True)
)
add("passes-unstated.csv", _passes, "graw.com (7 repeats and their mean)", refused="5 columns named x_mm, pass 1")
add(
    "passes.csv",
    _passes,
    "graw.com (7 repeats and their mean)",
    stated={"columns": {"x": "x_mm", "z": ["pass 1", "pass 2", "pass 3"]}},
    note="3 passes averaged",
)
_pairs = "W1_x,W1_z,W2_x,W2_z\n" + "".join(
    f"{x},{mm(z)},{f'{x},{mm(z / 2)}' if i < 181 else ','}\n" for i, (x, z) in enumerate(zip(X_MM, _basic, strict=True))
)
add("pairs-unstated.csv", _pairs, "pyqtgraph/pyqtgraph#2747, highcharts#17186", refused="4 columns named W1_x")
add("pairs.csv", _pairs, "pyqtgraph/pyqtgraph#2747, highcharts#17186", stated={"columns": {"x": "W1_x", "z": "W1_z"}})
_rails = table(
    ";", "Chainage_m;Left_mm;Right_mm", x=lambda x: fixed(1234 + x / 1000, 3, ","), z=mm_comma, behind=";0,000"
)
add("rails-unstated.csv", _rails, f"{RAITA} (Vasen, Oikea)", refused="Chainage_m, Left_mm, Right_mm; state which")
add(
    "rails.csv",
    _rails,
    f"{RAITA} (Vasen, Oikea)",
    stated={"columns": {"x": "Chainage_m", "z": "Left_mm"}, "rail": "left"},
    note="columns not used: Right_mm",
)

# Positions, order, sign

_plus = {"x": lambda x: f"12+{345.678 + x / 1000:07.3f}"}
add("chainage-plus.csv", semicolons("x;z_mm", **_plus), "bSI-InfraRoom/IFC-Specification#241 (KM26+236)")
add(
    "chainage-plus-finnish.csv",
    '"Running Date";"5/5/2022 8:47:01 AM"\n'
    + semicolons(
        '"SSCount";"Track";"Location [km+m]";"z [mm]"',
        x=lambda x: f'{x};"Track 127";752+{147 + x / 1000:08.3f}'.replace(".", ","),
    ),
    RAITA,
    note="columns not used: SSCount, Track",
)
add("chainage-km.csv", semicolons("km;z_mm", x=lambda x: fixed(12.345678 + x / 1e6, 6, ",")), "rank 16")
add("descending.csv", semicolons(places=X_MM[::-1]), "railmeasurement.com/programming-and-surveys", note="x descends")
add(
    "there-and-back.csv",
    semicolons(places=[*X_MM, *X_MM[::-1]]),
    "surveys with a trolley; the file is ours",
    refused="x does not increase from line 243",
)
add(
    "versines.csv",
    semicolons(["Sehne [mm];250", "Weg [mm];Pfeilhöhe [mm]"]).encode("cp1252"),
    "esveld.com/Railprof.html, KRAB trolley",
    refused="versines, not heights",
)
add("gap.csv", semicolons("x_mm;Spalt_mm", z=lambda z: mm_comma(-z)), "gensys trc_strix_track",
    stated={"z_positive": None}, note="z turned positive up")  # fmt: skip
add(
    "height-first.csv",
    "z_mm;x_mm\n" + "".join(f"{mm_comma(dip_um(x))};{x}\n" for x in X_MM),
    "ben-strasser/fast-cpp-csv-parser#14",
)
_numbered = semicolons(["Schrittweite [mm];5", "Start [mm];-600", "Nr;Höhe [mm]"], x=lambda x: str((x + 600) // 5 + 1))
add("numbered-unstated.csv", _numbered, PROFILOMETER, refused="state the spacing")
add("numbered.csv", _numbered, PROFILOMETER, stated={"spacing": 5.0})
add(
    "values-in-rows.csv",
    f"x_mm,{','.join(map(str, X_MM))}\nz_mm,{','.join(map(mm, _basic))}\n",
    "tkurita/octave-m load_profile_csv.m",
    refused="no samples",
)
add("from-zero.csv", semicolons(x=lambda x: str(x + 600)), "32 records of measurement.md", note="centred on x = 0.6 m")
add(
    "off-centre.csv",
    semicolons(x=lambda x: str(x + 1000), places=range(-1000, 401, 5)),
    "records of measurement.md (172 to 2,719 of 2,880 mm)",
    note="the defect, as no centre is stated",
    reach_m=(-1.0, 0.4),
)
add(
    "step-change.csv",
    semicolons(places=[*range(-600, -150, 10), *range(-150, 150, 5), *range(150, 601, 10)]),
    "SurfaceTopography's Mitutoyo reader keeps such scans",
)
add(
    "civil.txt",
    table(" ", x=lambda x: fixed(x / 1000 + 100, 3), z=lambda z: fixed(z / 1e6, 6)),
    "help.autodesk.com Civil 3D profile file (station, elevation)",
    stated={"x_unit": "m", "z_unit": "m"},
)

# Containers, and files that are cut

_plain = table(",", "x_mm,z_mm")
add("page.xls", f"<html><table>\n<tr><td>{_plain}</td></tr></table></html>", "SheetJS/sheetjs#458", refused="HTML page")
add("text.xls", table("\t", "x_mm\tz_mm"), "python-excel/xlrd#351, tidyverse/readxl#598")
add("plain.csv.gz", gzip.compress(_plain.encode()), "gbif/ipt#1903", refused="compressed (gzip); unpack it")
add("named.csv", gzip.compress(_plain.encode()), "gbif/ipt#897", refused="compressed (gzip); unpack it")
add("one.zip", archive(**{"W1.csv": _plain}), "dhis2/dhis2-core#2966", note="unpacked from a ZIP archive")
add("two.zip", archive(**{"W1.csv": _plain, "W2.csv": _plain}), "gbif/ipt#897", refused="an archive of 2 files")
add("cut.zip", archive(**{"W1.csv": _plain})[:-40], "gbif/ipt#897", refused="cannot be unpacked")
_protocol: list[list[object]] = [["Messprotokoll"], ["Datum", "13.05.2024"], ["Schweißung", "W 12"], []]
_protocol += [["Weg [mm]", "Höhe [mm]", "Seite [mm]"]]
_protocol += [[x, round(z / 1000, 4), 0.01] for x, z in zip(X_MM, _basic, strict=True)]
add("protocol.xlsx", workbook(("Protokoll", _protocol), ("Grafik", [["Diagramm"]])), "SurfaceTopography#226, PapaParse")
add("no-table.xlsx", workbook(("Grafik", [["Diagramm"]])), "SurfaceTopography#226", refused="(sheets: 'Grafik')")
add("cut.xlsx", workbook(("Protokoll", _protocol))[:3000], "watchfiles#345", refused="cannot be unpacked")
add(
    "cut-in-last-row.csv",
    semicolons()[:-5],
    "open-watcom#1594, watchfiles#345",
    note="line 242, the last, is cut off: left out",
    reach_m=(-0.6, 0.595),
)
add("cut-between-fields.csv", semicolons()[:-6], "watchfiles#345", note="line 242, the last, is cut off",
    reach_m=(-0.6, 0.595))  # fmt: skip
add("cut-at-line-end.csv", semicolons()[:-1], "watchfiles#345")
add("cut-in-dip.csv", semicolons(places=X_MM[:131])[:-4], "rank 4", refused="the record ends within the weld")
add("tenths.csv", table(",", "x_mm,z_um", z=um), "rank 5; a tenth of a micrometre")


def all_forms() -> list[Form]:
    """Return these and those of `instrument_forms`."""
    return FORMS
