# Generated shock in two gases (volume build --generate shock): `value r g b opacity` a line. Everything is seen: the light
# gas blue, the heavy gas green to yellow, packed by the shock orange to white.
0.00  0.10 0.10 0.40  0.002
0.10  0.10 0.20 0.70  0.006
0.17  0.15 0.45 0.85  0.012
0.28  0.20 0.65 0.50  0.020
0.42  0.70 0.80 0.25  0.040
0.58  0.95 0.55 0.10  0.030
0.75  1.00 0.30 0.15  0.070
0.97  1.00 0.85 0.65  0.050
1.00  1.00 1.00 1.00  0.100
