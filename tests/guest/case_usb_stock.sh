#!/usr/bin/dash
# In the guest: `serve` puts a room on USB/IP; the stock usbip lists and attaches it over loopback TCP, lsusb reads every
# descriptor, and evtest reads, through the kernel's own hid-logitech, hid-generic and xpad, what a script says the pads do.
# judge_usb_stock.sh judges the output. For the adapter of a monitor a program of ours does what usbip attach does.
mkdir -p /var/run
cd /tmp || exit 1
cat >pad.txt <<'END'
5 axis 1 0.5 0
5.2 axis 1 -1 0
5.4 axis 1 0 0
5.6 button 2 down
5.8 button 2 up
6 axis 5 1 0
6.2 axis 5 0 0
6.4 axis 3 -0.5 0
6.6 axis 3 0 0
END
{ case_desk.sh && cat <<'END'; } >room.yaml
cameras:
  - {id: c1, position_m: [0, 1.36, 0.02], look_at_m: [0, 1.2, 0.65], pixels: [640, 480], fov_deg: 56, rate_hz: 60, sync: display}
gamepads:
  - {id: pad, model: rumblepad2, script: pad.txt}
  - {id: mouse, model: spacemouse, script: pad.txt}
  - {id: x1, model: xbox360, script: pad.txt}
bodies:
  glasses:
    markers_mm: [[0, 0, 0], [151, 11, -17], [62, 31, 12], [25, 21, -35], [130, 33, -40]]
    eyes_mm: [75, -8, 16]
END
: >serve.txt
serve_room serve room.yaml --fault "at 9s gamepad/pad unplug" --fault "at 9s camera/c1 unplug" >serve.txt 2>&1 &
server=$!
until grep -q serving serve.txt; do sleep 0.05; done
cat serve.txt
echo "== list"
usbip list -r 127.0.0.1 2>/dev/null
echo "== attach"
# Word for word what serve said.
sed -n 's/.*modprobe vhci-hcd; //p' serve.txt | while read -r line; do
	$line && echo "attached: $line"
done
usbip_attach hold 15 >/dev/null &

node_of() { # NAME: its event node, when it has come; of a receiver's four pads only one says that it is there
	tries=0
	until grep -l "$1" /sys/class/input/event*/device/name 2>/dev/null || [ $tries = 60 ]; do
		sleep 0.05
		tries=$((tries + 1))
	done | cut -d/ -f5 | head -n 1
}

for name in 'Cordless RumblePad 2' 'SpaceMouse Wireless' 'Xbox 360 Wireless Receiver'; do
	node=$(node_of "$name")
	evtest "/dev/input/$node" >"evtest.$node" 2>&1 &
done
sleep 5 # the script ends
for file in evtest.*; do
	echo "== evtest $(cat "/sys/class/input/${file#evtest.}/device/name")"
	cat "$file"
done
# lsusb reads a HID interface's report descriptor when no driver has it.
for interface in /sys/bus/usb/drivers/usbhid/*:*; do
	echo "${interface##*/}" >/sys/bus/usb/drivers/usbhid/unbind
done
for id in 131d:0157 046d:c219 256f:c62e 045e:0719 1c40:0534; do
	echo "== lsusb -v $id"
	lsusb -v -d $id 2>&1
done
echo "== attached"
usbip port 2>/dev/null | grep -c 'Port in Use'
sleep 3 # the faults have come
echo "== end"
usbip list -r 127.0.0.1 2>/dev/null | grep '([0-9a-f]*:[0-9a-f]*)'
lsusb | grep -v 1d6b
kill $server
wait $server
