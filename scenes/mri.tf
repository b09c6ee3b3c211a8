# Brain scan, echo planar: `value r g b opacity` a line, value and all else 0..1, opacity per voxel, linear between.
# Air is 0, scalp and noise stay below 0.2, grey and white matter lie at 0.35 .. 0.6, fluid above 0.7. Opacity grows
# without a step anywhere, so that twice the samples give the same picture.
0.00  0.00 0.00 0.00  0.000
0.10  0.15 0.02 0.02  0.000
0.20  0.35 0.08 0.05  0.003
0.30  0.55 0.20 0.12  0.008
0.40  0.72 0.38 0.24  0.018
0.50  0.85 0.58 0.40  0.032
0.60  0.94 0.76 0.58  0.050
0.70  0.98 0.89 0.76  0.070
0.80  0.99 0.96 0.90  0.092
0.90  1.00 0.99 0.97  0.115
1.00  1.00 1.00 1.00  0.140
