#!/usr/bin/dash
# In the guest: candump reads what smoke_can sends, every frame with every byte.
ip link add dev vcan0 type vcan && ip link set up vcan0 || exit 1
candump -L -n 400 vcan0 >/tmp/dump &
sleep 0.2
smoke_can 200 vcan0 vcan0 || exit 1
wait
i=0
while [ $i -lt 200 ]; do
	for id in 101 102; do
		printf 'vcan0 %s#%02X000000A5A5A5A5\n' $id $i
	done
	i=$((i + 1))
done >/tmp/want
cut -d' ' -f2,3 /tmp/dump >/tmp/got
cmp /tmp/want /tmp/got && echo "candump agrees: $(wc -l </tmp/got) frames"
