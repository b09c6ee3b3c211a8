# Generated vortices over a delta wing (volume build --generate delta): `value r g b opacity` a line. Only the thin air of
# the vortices is seen, a few voxels in a hundred.
0.00  1.00 1.00 1.00  0.160
0.15  0.80 0.95 1.00  0.130
0.28  0.35 0.75 1.00  0.090
0.38  0.15 0.45 0.95  0.045
0.45  0.10 0.20 0.70  0.012
0.49  0.08 0.10 0.45  0.000
1.00  0.08 0.10 0.45  0.000
