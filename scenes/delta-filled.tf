# Generated vortices over a delta wing (volume build --generate delta): `value r g b opacity` a line. Everything is seen:
# the slow variations of the free stream green, vortices blue to white, packed air below the wing red.
0.00  1.00 1.00 1.00  0.150
0.25  0.40 0.75 1.00  0.090
0.45  0.12 0.30 0.85  0.030
0.57  0.10 0.50 0.60  0.008
0.61  0.15 0.65 0.40  0.005
0.65  0.40 0.75 0.25  0.006
0.72  0.85 0.65 0.15  0.020
0.85  0.95 0.30 0.10  0.060
1.00  0.80 0.10 0.10  0.110
