# Generated solar wind (volume build --generate enlil): `value r g b opacity` a line. Everything is seen: thin fast wind
# blue, slow wind along the sheet green to yellow, mass ejections red to white.
0.00  0.05 0.05 0.30  0.001
0.04  0.08 0.20 0.65  0.003
0.07  0.10 0.45 0.75  0.005
0.12  0.25 0.70 0.45  0.008
0.17  0.75 0.80 0.25  0.013
0.22  0.90 0.60 0.15  0.020
0.35  0.95 0.30 0.10  0.045
0.60  1.00 0.70 0.40  0.090
1.00  1.00 1.00 1.00  0.150
