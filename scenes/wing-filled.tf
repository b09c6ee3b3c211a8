# Generated vortices of leading-edge extensions (volume build --generate wing): `value r g b opacity` a line. Everything
# is seen: the free stream green, vortices blue to white, packed air and the body orange to red.
0.00  1.00 1.00 1.00  0.150
0.25  0.40 0.75 1.00  0.090
0.40  0.12 0.30 0.85  0.030
0.48  0.10 0.50 0.60  0.008
0.515 0.15 0.65 0.40  0.005
0.55  0.40 0.75 0.25  0.007
0.62  0.85 0.65 0.15  0.025
0.75  0.95 0.40 0.10  0.060
1.00  0.80 0.10 0.10  0.110
