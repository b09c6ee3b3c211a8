#!/usr/bin/dash
# In the guest: gpiodetect and gpioinfo know our chip, gpioget reads the world's level, gpioset reaches the world, and
# gpiomon sees the edges of a wave, each one period after the other.
gpiodetect
gpiodetect | grep -q '^gpiochip0 \[bb-gpio\] (8 lines)$' && gpioinfo gpiochip0 | grep -q 'line *3: .* input ' || exit 1
echo "set 5 1" >/dev/bb-gpio
[ "$(gpioget gpiochip0 5 6)" = "1 0" ] || { echo "gpioget: $(gpioget gpiochip0 5 6)"; exit 1; }
gpioset --mode=time --usec=50000 gpiochip0 4=1 &
sleep 0.02
[ "$(cat /dev/bb-gpio)" = 00001100 ] || { echo "gpioset: $(cat /dev/bb-gpio)"; exit 1; }
wait
echo "wave 3 8333333" >/dev/bb-gpio
gpiomon -n 16 --format='%e %s %n' gpiochip0 3 | tee /tmp/edges
awk '{ t = $2 * 1000000000 + $3 }
	NR > 1 { d = t - last - 8333333; if (d < 0) d = -d; if (d > 25000 || $1 == level) bad = 1; if (d > worst) worst = d }
	{ last = t; level = $1; n++ }
	END { print n " edges, at most " worst / 1000 " us off their places"; exit bad || n != 16 }' /tmp/edges
