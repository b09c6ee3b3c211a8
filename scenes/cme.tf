# Coronal mass ejection: `value r g b opacity` a line, opacity per voxel. Haze is blue and thin, shells go from red to
# yellow, the core is white.
0.00  0.00 0.00 0.00  0.000
0.04  0.02 0.03 0.10  0.000
0.10  0.05 0.10 0.35  0.003
0.20  0.35 0.08 0.30  0.009
0.30  0.70 0.14 0.10  0.020
0.42  0.90 0.36 0.06  0.036
0.55  0.98 0.62 0.12  0.056
0.70  1.00 0.85 0.40  0.080
0.85  1.00 0.96 0.78  0.110
1.00  1.00 1.00 1.00  0.150
