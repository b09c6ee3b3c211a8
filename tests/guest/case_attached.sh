#!/usr/bin/dash
# Devices of every bus there is without a wire: what `blackburst devices` says of them, and whose our udev rules made them.
ip link add vcan0 type vcan && ip link add vcan1 type vcan && ip link set up vcan1 && attached \
	"gpio:/dev/gpiochip0?line=3=here,blackburst:660" \
	"can:vcan0=refused" "can:vcan1=here" "can:vcan2=missing" \
	"i2c:/dev/i2c-0=here,root:600" "i2c:/dev/i2c-7=missing" \
	"hid:046d:c218?serial=S7=here,blackburst:660" "hid:046d:c219=missing" \
	"evdev:046d:c218=here,blackburst:660"
