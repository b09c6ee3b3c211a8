#!/bin/sh
# On the host: tshark's CANopen dissector reads what candump wrote in the case can_chain, and must find in it what docs/
# shutter-od.md says is there: NMT, boot-up and heartbeats, SYNC with its counter, phases and follow-ups that carry it,
# every SDO answered for the same object, an emergency and its end. No frame is malformed or of another protocol.
command -v tshark >/dev/null || { echo "tshark is not installed (packages-kernel.txt)"; exit 1; }
log=$(mktemp)
trap 'rm -f "$log" "$log.csv"' EXIT
sed -n 's/^log: //p' | base64 -d | gunzip >"$log" && [ -s "$log" ] || { echo "there is no log of candump"; exit 1; }
tshark -r "$log" -d can.subdissector,canopen -T fields -E separator=, -e frame.protocols -e can.id \
	-e canopen.function_code -e canopen.node_id -e canopen.nmt_ctrl.cd -e canopen.nmt_ctrl.node_id -e canopen.nmt_guard.state \
	-e canopen.sync.counter -e canopen.sdo.main_idx -e canopen.sdo.sub_idx -e canopen.sdo.data.bytes -e canopen.sdo.abort_code \
	-e canopen.em.err_code -e canopen.em.err_reg -e canopen.pdo.data.bytes -e _ws.malformed -e _ws.expert.severity \
	>"$log.csv" 2>/dev/null || { echo "tshark cannot read the log"; exit 1; }
awk -F, -v frames="$(wc -l <"$log")" '
function hex(s,    n, i) { # of "0x1f" or "1f"
	sub(/^0x/, "", s); n = 0
	for (i = 1; i <= length(s); i++) n = 16 * n + index("0123456789abcdef", substr(s, i, 1)) - 1
	return n
}
function wrong(text) { print "frame " NR ": " text ": " $0; bad++ }
{ code = hex($3); node = hex($4) }
$1 !~ /canopen$/ { wrong("no CANopen") }
$16 != "" || $17 != "" { wrong("malformed") }
code == 0 { nmt = nmt " " hex($5) ":" hex($6); if (hex($5) == 1) running = 1 }
code == 1 && node == 0 {
	if (syncs++ && $8 != counter % 240 + 1) wrong("SYNC counter after " counter)
	counter = $8
}
code == 1 && node != 0 { emcy = emcy " " node ":" $13 ":" $14 }
code == 3 { # counter, flags, phase, sequence, CRC; an odd counter is the left eye
	phases[node]++
	if (length($15) != 16) wrong("phase of another length")
	if (hex(substr($15, 1, 2)) != counter) wrong("phase of another edge than SYNC " counter)
	if (hex(substr($15, 3, 2)) != 4 + (counter % 2 ? 1 : 2)) wrong("flags of a phase")
}
code == 5 {
	follows++
	if (node != 1 || length($15) != 12 || hex(substr($15, 1, 2)) != counter) wrong("follow-up")
}
code == 12 { asked[node] = $9 $10; if ($11 != "") writes[node, $9 $10] = $11; requests++ }
code == 11 {
	if ($12 != "") wrong("SDO abort")
	if ($9 != "" && $9 $10 != asked[node]) wrong("SDO reply to " asked[node])
	if ($11 != "") read[node, $9 $10] = $11
	answers++
}
code !~ /^(0|1|3|5|11|12|14)$/ { wrong("not of this chain") }
code == 14 { beats[node, hex($7)]++; if (!running && hex($7) == 5 && node != 127) wrong("operational before its start") }
END {
	if (NR != frames) wrong("frames in the log: " frames)
	if (nmt != " 128:0 1:0 128:0") wrong("NMT" nmt)
	if (emcy != " 3:0x4200:0x09 3:0x0000:0x00") wrong("EMCY" emcy)
	if (requests != answers || requests < 60) wrong("SDO requests " requests ", answers " answers)
	for (n = 1; n <= 3; n++) {
		if (beats[n, 0] != 1 || beats[n, 5] < 20) wrong("boot-up and heartbeats of node " n)
		if (phases[n] < syncs - 20 || phases[n] > syncs) wrong("phases of node " n ": " phases[n])
		if (read[n, "0x10000x00"] != "00005300") wrong("device type of node " n)
		if (substr(writes[n, "0x10190x00"], 1, 2) != "f0") wrong("SYNC overflow of node " n)
		if (writes[n, "0x21000x01"] != "c0c62d00" || read[n, "0x21000x01"] != "c0c62d00") wrong("delay of node " n) # 3 ms
	}
	if (syncs < 400 || follows < syncs - 20) wrong("SYNCs " syncs ", follow-ups " follows)
	if (bad) print bad " complaints"
	else print "tshark agrees: " frames " frames, " syncs " SYNCs, " phases[1] + phases[2] + phases[3] " phases, " requests " SDOs"
	exit bad > 0
}' "$log.csv"
