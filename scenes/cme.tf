# Coronal mass ejection: `value r g b opacity` a line, opacity per voxel. Haze is blue and thin, shells go from red to
# yellow, the core is white.
0.00  0.00 0.00 0.00  0.000
0.04  0.05 0.06 0.25  0.000
0.10  0.10 0.18 0.55  0.004
0.18  0.45 0.12 0.40  0.012
0.27  0.85 0.20 0.14  0.027
0.38  0.98 0.46 0.08  0.048
0.52  1.00 0.72 0.18  0.074
0.68  1.00 0.90 0.48  0.104
0.85  1.00 0.98 0.82  0.130
1.00  1.00 1.00 1.00  0.150
