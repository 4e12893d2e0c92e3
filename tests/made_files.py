"""Made files of instruments: no instrument wrote them; they follow the documented grammars."""

import struct

RTL = """HEADER::\r
File type  : rtl\r
Owner      : Linear\r
Version no : 20.02\r
TARGET DATA::\r
Filetype  : ISO\r
Target-count: 7\r
Targets :\r
 -150.000000 -100.000000 -50.000000\r
 0.000000 50.000000 100.000000\r
  150.000000\r
Flags: 0 0 2 0\r
USER-TEXT::\r
Machine:Fr\u00e4szentrum 20\u00b0 Serial No:7\r
RUNS::\r
Run-count:2\r
DEVIATIONS::\r
Run Target Data:\r
  1   1    0.100000\r
  1   2    0.250000\r
  1   3   -0.500000\r
  1   4    0.000000\r
  1   5    1.500000\r
  1   6    2.250000\r
  1   7    3.125000\r
  2   7    4.125000\r
  2   6    3.250000\r
  2   5    2.500000\r
  2   4    1.000000\r
  2   3    0.500000\r
  2   2    1.250000\r
  2   1    1.100000\r
EQUIPMENT::\r
Laser : XL\r
ENVIRONMENT::\r
Air temp   : 20.337280 20.384956 0\r
Mat temp 1 : 20.203292 20.321342 0\r
Mat temp 2 : -10.000000 -10.000000 0\r
Exp coeff  : 8.000000 8.000000 0\r
Date Time  : "10:46 Dec 12 2016" "11:01 Dec 12 2016"\r
EOF::\r
"""
WIDE = """Target [mm];Run 1 + [\u00b5m];Run 1 - [\u00b5m];Run 2 + [\u00b5m];Run 2 - [\u00b5m]
-100;1,5;2,25;0,125;2
0;-1,5;2,75;0,5;2,5
100;3;;4,25;1
"""
ECMC = """# Made input data file for ISO230-2 calculations
UNIT=mm
CYCLES=2
POSITIONS=2
TGT_DATA[1]=-10
TGT_DATA[2]=.24
REF_DATA_FWD[1,1]=-10.0000990190
REF_DATA_FWD[2,1]=.2399139810
REF_DATA_FWD[1,2]=-10.0000940190
REF_DATA_FWD[2,2]=.2398979810
REF_DATA_BWD[1,1]=-10.0000810190
REF_DATA_BWD[2,1]=.2399279810
REF_DATA_BWD[1,2]=-10.0001020190
REF_DATA_BWD[2,2]=.2399099810
"""
REPORT = """# ecmc motion system test report (made)

Unit | mm
Cycle count |2 (j=1..2)

### Data forward direction

i |tgt_pos(i) [mm]|ref_pos(i,1) [mm]|ref_pos(i,2) [mm]|
--- |--- |--- |--- |
1|-10.0|-10.000099|-10.000094|
2|0.24|0.239914|0.239898|

### Data backward direction

i |tgt_pos(i) [mm]|ref_pos(i,1) [mm]|ref_pos(i,2) [mm]|
--- |--- |--- |--- |
1|-10.0|-10.000081|-10.000102|
2|0.24|0.239928|0.23991|

## ISO230-2 calculations:

i |x_avg(i) [mm]|B(i) [mm]|
1|-9.222e-05|-4e-07|
"""
LASER = """Comments:
made, of no axis

Environmental Data
Air Temp\t20.1

Statistical Analysis:
Accuracy\t3.2

Raw Data:
Target Position\tRun 1 F\tRun 1 R
0\t0.1\t0.2
50\t0.4\t0.6
100\t0.9\t1.0
"""
CALYPSO = """planid\tpartnb\tid\ttype\tidsymbol\tactual\tnominal\tuppertol\tlowertol\tdeviation\t\
featureid\tunit
p\t17\tX of hole 1\txValue\tX\t10,0021\t10,0000\t0,1\t-0,1\t0,0021\thole1\tmm
p\t17\tY of hole 1\tyValue\tY\t20,0010\t20,0000\t0,1\t-0,1\t0,0010\thole1\tmm
p\t17\tDiameter 1\tdiameter\tD\t6,0005\t6,0000\t0,1\t-0,1\t0,0005\thole1\tmm
END
"""
PCDMIS = """PART NAME : made      SER NUMBER : 42
DIM LOC1= LOCATION OF CIRCLE CIR1  UNITS=MM ,$
AX    NOMINAL    +TOL    -TOL    MEAS    DEV    OUTTOL
X     10.000   0.050   0.050   10.0031   0.0031   0.000
Y     20.000   0.050   0.050   20.0012   0.0012   0.000
D      6.000   0.050   0.050    6.0100   0.0100   0.000
"""
DFQ = (
    "K0100 2\nK1001 4711\nK1002 Deckel\x85gro\u00df\n"
    "K2002/1 hole1.X\nK2004/1 0\nK2101/1 10,000\nK2142/1 mm\n"
    "K2002/2 hole1.Y\nK2004/2 0\nK2101/2 20,000\nK2142/2 mm\n"
)
DFQ_COMPACT = DFQ + (
    "10,0021\x140\x1412.08.1999/10:00:00\x0f20,0010\x140\x1412.08.1999/10:00:00\n"
    "10,0035\x140\x1413.08.1999/10:00:00\x0f99,0000\x14255\x1413.08.1999/10:00:00\n"
)
DFQ_LONG = DFQ + "K0001/1 10,0021\nK0002/1 0\nK0001/2 20,0010\nK0002/2 0\n"
QIF = """<?xml version="1.0" encoding="UTF-8"?>
<QIFDocument xmlns="http://qifstandards.org/xsd/qif3"><FileUnits><PrimaryUnits><LinearUnit>
<UnitName>mm</UnitName><UnitConversion><Factor>0.001</Factor></UnitConversion></LinearUnit>
</PrimaryUnits></FileUnits>
<Features><FeatureItems><CircleFeatureItem id="5"><FeatureName>hole1</FeatureName>
</CircleFeatureItem></FeatureItems></Features>
<MeasurementsResults><MeasurementResults id="9"><MeasuredFeatures><FeatureActuals>
<CircleFeatureActual id="11"><FeatureItemId>5</FeatureItemId><Location>10.0021 20.0010 0</Location>
</CircleFeatureActual></FeatureActuals></MeasuredFeatures><MeasuredCharacteristics>
<CharacteristicActuals><DiameterCharacteristicActual id="12"><Value>6.0005</Value>
</DiameterCharacteristicActual></CharacteristicActuals></MeasuredCharacteristics>
</MeasurementResults></MeasurementsResults></QIFDocument>
"""
B5R = """<?xml version="1.0"?><BALLBAR><TEST_PLANE>XY</TEST_PLANE><MACHINE_TESTED NAME="mill"/>
<FEATURE NAME="AF_SQUARENESS" DT="UT_SQUARENESS">-12.5</FEATURE>
<FEATURE NAME="AF_CIRCULARITY" DT="UT_LENGTH_UM" VALUE="8.4"/></BALLBAR>
"""
WIDE_POINTS = """Feature;Axis;Nominal;P1;P2
hole1;X;10,000;10,0021;10,0035
hole1;Y;20,000;20,0010;
hole2;X;110,000;110,0042;110,0051
hole2;Y;20,000;19,9990;20,0030
"""
LOGGER = """Logger of no plant (made)
Zeit;T spindle [\u00b0C];T bed [\u00b0C];Probe Z [\u00b5m]
13.08.2024 10:00:00;20,10;20,05;0,0
13.08.2024 10:01:00;20,25;20,06;0,4
13.08.2024 10:02:00;20,40;20,08;0,9
"""
MAP = """schema: mtu/import/1
skip_rows: 1
columns: {position_mm: Ziel}
unpivot: {into: error, columns: [M1, M2], directions: alternate}
subtract: {error: position_mm}
units: {error: mm}
constants: {component: dx_x}
cycles: {from: S}
"""
MAPPED = "Titel\nZiel;M1;M2;Note;S\n0;0,001;0,002;a;1\n100;100,001;;b;2\n50;50,5;50,25;c;1\n"


def rtx() -> bytes:
    samples = (0.5, -0.25, 1e-3)
    head = f"Owner : CARTO-Dynamic\r\nFile Type : rtx\r\nSample no : {len(samples)}\r\nData:\r\n"
    return head.encode() + struct.pack(f"<{len(samples)}d", *samples) + b"EOF::\r\n"


FILES: dict[str, tuple[str, bytes]] = {
    "x.rtl": ("rtl", RTL.encode("cp1252")),
    "yaw.rta": ("rta", RTL.replace("rtl", "rta").encode()),
    "wide.csv": ("wide", WIDE.encode("cp1252")),
    "e.dat": ("ecmc-iso230", ECMC.encode()),
    "e.md": ("ecmc-iso230", REPORT.encode()),
    "laser.txt": ("laser-text", LASER.encode()),
    "p_chr.txt": ("calypso", CALYPSO.encode("cp1252")),
    "r.txt": ("pcdmis-text", PCDMIS.encode()),
    "c.dfq": ("dfq", DFQ_COMPACT.encode("latin-1")),
    "l.dfq": ("dfq", DFQ_LONG.encode("latin-1")),
    "a.qif": ("qif", QIF.encode()),
    "b.b5r": ("b5r", B5R.encode()),
    "p.csv": ("wide-points", WIDE_POINTS.encode()),
    "t.csv": ("logger", LOGGER.encode("cp1252")),
    "d.rtx": ("rtx", rtx()),
}
"""Name of the file: its format and bytes."""
