# Generated shock in two gases (volume build --generate shock): `value r g b opacity` a line. The gases themselves are not
# seen, only what lies between their densities: the mixing layer and the fronts.
0.00  0.10 0.10 0.40  0.000
0.19  0.10 0.20 0.60  0.000
0.23  0.15 0.45 0.85  0.030
0.26  0.20 0.60 0.80  0.000
0.31  0.20 0.60 0.60  0.000
0.36  0.30 0.80 0.45  0.050
0.45  0.85 0.85 0.25  0.080
0.53  0.95 0.60 0.15  0.000
0.62  0.95 0.45 0.10  0.000
0.72  1.00 0.30 0.15  0.090
0.88  1.00 0.80 0.60  0.000
1.00  1.00 1.00 1.00  0.000
