# Generated solar wind: `value r g b opacity` a line, opacity per voxel. Fast wind is a thin blue, the slow wind along the
# sheet green to yellow, mass ejections red to white.
0.00  0.05 0.05 0.30  0.000
0.03  0.06 0.16 0.70  0.004
0.06  0.08 0.40 0.90  0.010
0.10  0.15 0.75 0.65  0.016
0.15  0.60 0.85 0.25  0.026
0.22  0.95 0.75 0.15  0.045
0.35  1.00 0.35 0.10  0.090
0.60  1.00 0.75 0.45  0.140
1.00  1.00 1.00 1.00  0.180
