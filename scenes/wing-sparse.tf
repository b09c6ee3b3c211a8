# Generated vortices of leading-edge extensions (volume build --generate wing): `value r g b opacity` a line. Only the
# thin air of the vortices is seen, a few voxels in a hundred.
0.00  1.00 1.00 1.00  0.170
0.18  0.85 0.95 1.00  0.130
0.30  0.40 0.75 1.00  0.080
0.39  0.15 0.40 0.90  0.025
0.43  0.08 0.15 0.55  0.000
1.00  0.08 0.15 0.55  0.000
