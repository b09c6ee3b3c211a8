# Generated shells (generate: cme): `value r g b opacity` a line. Everything is seen: the dark around it too, haze blue,
# shells red to yellow, the core white.
0.00  0.02 0.03 0.10  0.001
0.02  0.05 0.06 0.25  0.003
0.10  0.10 0.18 0.55  0.008
0.18  0.45 0.12 0.40  0.016
0.27  0.85 0.20 0.14  0.030
0.38  0.98 0.46 0.08  0.050
0.52  1.00 0.72 0.18  0.075
0.85  1.00 0.98 0.82  0.130
1.00  1.00 1.00 1.00  0.150
