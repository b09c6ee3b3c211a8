#!/usr/bin/dash
# In the guest: two real controllers on one emulated bus, set up by the kernel's own means.
for interface in can0 can1; do
	ip link set $interface type can bitrate 500000 restart-ms 100 && ip link set up $interface || exit 1
done
smoke_can 500 can0 can1 && ip -details link show can0 | grep -o 'state [A-Z-]* .*restart-ms 100'
