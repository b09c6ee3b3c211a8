# Generated solar wind (volume build --generate enlil): `value r g b opacity` a line. Only the sheaths and cores of the
# mass ejections are seen, a few voxels in a hundred.
0.00  0.05 0.05 0.20  0.000
0.22  0.25 0.10 0.35  0.000
0.28  0.70 0.18 0.25  0.015
0.38  0.95 0.45 0.10  0.045
0.55  1.00 0.75 0.25  0.090
0.80  1.00 0.95 0.70  0.130
1.00  1.00 1.00 1.00  0.150
