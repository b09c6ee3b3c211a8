#!/usr/bin/dash
# In the guest: evtest reads what smoke_evdev sends, until the pad is unplugged.
smoke_evdev paced &
sleep 0.5
pad=$(grep -l 'a pad by uinput' /sys/class/input/event*/device/name | cut -d/ -f5)
evtest "/dev/input/$pad" >/tmp/events 2>&1
wait $! || exit 1
sticks=$(grep -c 'type 3 (EV_ABS), code 0 (ABS_X), value' /tmp/events)
buttons=$(grep -c 'type 1 (EV_KEY), code 304 (BTN_SOUTH), value' /tmp/events)
echo "evtest saw $sticks moves, $buttons buttons"
[ "$sticks" = 500 ] && [ "$buttons" = 50 ] || { tail -n 30 /tmp/events; exit 1; }
