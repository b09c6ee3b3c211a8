# Brain scan, echo planar: `value r g b opacity` a line, value and all else 0..1, opacity per voxel, linear between.
# Air is 0, scalp and noise stay below 0.2, white and grey matter lie at 0.35 .. 0.6, fluid above 0.7. Opacity grows
# without a step anywhere, so that twice the samples give the same picture.
0.00  0.00 0.00 0.00  0.000
0.10  0.15 0.02 0.02  0.000
0.20  0.40 0.08 0.05  0.003
0.28  0.62 0.18 0.12  0.008
0.36  0.82 0.42 0.30  0.018
0.44  0.93 0.66 0.50  0.036
0.52  0.98 0.84 0.72  0.062
0.60  1.00 0.95 0.88  0.090
0.70  0.95 0.97 1.00  0.115
0.85  0.88 0.95 1.00  0.140
1.00  1.00 1.00 1.00  0.160
