# Generated shells (generate: cme): `value r g b opacity` a line. Only the core and the brightest parts of the shells are
# seen, a few voxels in a hundred.
0.00  0.05 0.06 0.25  0.000
0.42  0.85 0.20 0.14  0.000
0.52  0.98 0.46 0.08  0.050
0.68  1.00 0.80 0.30  0.100
0.85  1.00 0.98 0.82  0.130
1.00  1.00 1.00 1.00  0.150
