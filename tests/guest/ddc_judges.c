/*
 * tests/guest/ddc_judges.c: stock programs judge our monitors on the kernel's i2c bus, and our driver reads the same bus:
 * ddcutil's detect, getvcp, setvcp and capabilities beside what blackburst reads and what is really set; edid-decode on
 * the EDID of every model, as it comes over the bus. Prints the tables and one JSON line; exit 1 when anything differs.
 */
#include "drivers/edid.h"
#include "drivers/vcp_capabilities.h"
#include "sim/edid_model.h"
#include "tests/guest/monitor_stage.h"

#define TEXT_MAX 65536

static int wrong, compared;

static void check(bool same, const char *what)
{
	compared++;
	if (same)
		return;
	wrong++;
	printf("DIFFERS: %s\n", what);
}

/* What a stock program says on both its outputs. */
static const char *run(const char *format, const char *argument)
{
	static char text[TEXT_MAX];
	char command[256];

	snprintf(command, sizeof(command), format, argument);
	FILE *f = popen(command, "r");
	NEED(f);
	text[fread(text, 1, sizeof(text) - 1, f)] = '\0';
	const int status = pclose(f);
	if (status)
		printf("\"%s\" ended with %d and said:\n%s\n", command, status, text);
	return text;
}

/* "VCP 10 C 75 100", "VCP 60 SNC x0f", "VCP C0 CNC x00 x00 x26 x94", "VCP 59 ERR": the current value, -1 for ERR. */
static long value_of(const char *text, unsigned int code)
{
	unsigned int b[4];
	char begins[16], type[8] = "", rest[64] = "";
	long value = -2;

	snprintf(begins, sizeof(begins), "VCP %02X ", code);
	const char *line = strstr(text, begins);
	if (!line || sscanf(line + strlen(begins), "%7s %63[^\n]", type, rest) < 1)
		return -2;
	if (!strcmp(type, "ERR"))
		return -1;
	if (!strcmp(type, "C") && sscanf(rest, "%ld", &value) == 1)
		return value;
	if (!strcmp(type, "SNC") && sscanf(rest, "x%x", &b[0]) == 1)
		return (long)b[0];
	if (!strcmp(type, "CNC") && sscanf(rest, "x%x x%x x%x x%x", &b[0], &b[1], &b[2], &b[3]) == 4)
		return (long)(b[2] << 8 | b[3]);
	return -2;
}

static void show(char out[16], long value)
{
	snprintf(out, 16, value < 0 ? "none" : "%ld", value);
}

static void judge_values(struct stage *s, struct bb_monitor *m, const char *number)
{
	static const uint8_t codes[] = { 0x02, 0x10, 0x12, 0x14, 0x16, 0x18, 0x1A, 0x60,
		                          0xAC, 0xAE, 0xC0, 0xC6, 0xC8, 0xD6, 0xDF, 0x59 };
	char command[64], cell[3][16];

	printf("%-4s %10s %10s %10s\n", "VCP", "ddcutil", "blackburst", "truth");
	for (size_t i = 0; i < BB_ARRAY_LEN(codes); i++) {
		bool has;
		snprintf(command, sizeof(command), "ddcutil --bus %s --terse getvcp %02X 2>&1 || true", number, codes[i]);
		const long theirs = value_of(run("%s", command), codes[i]);
		const struct bb_monitor_reply r = stage_ask(s, m, BB_MONITOR_GET, codes[i], 0);
		const long ours = r.status == BB_OK ? r.current : r.status == BB_ERR_UNSUPPORTED ? -1 : -2;
		const uint16_t set = stage_truth(s, 0, codes[i], &has);
		const long truth = has ? set : -1;
		show(cell[0], theirs);
		show(cell[1], ours);
		show(cell[2], truth);
		printf("%02X   %10s %10s %10s\n", codes[i], cell[0], cell[1], cell[2]);
		check(theirs == truth && ours == truth, command);
	}
}

/* What one writes the other reads. */
static void judge_writes(struct stage *s, struct bb_monitor *m, const char *number)
{
	static const uint16_t values[] = { 0, 33, 50, 77, 100 };
	char command[80];
	bool has;

	printf("%-30s %10s %10s\n", "written", "read", "truth");
	for (size_t i = 0; i < BB_ARRAY_LEN(values); i++) {
		snprintf(command, sizeof(command), "ddcutil --bus %s setvcp 10 %u 2>&1", number, values[i]);
		run("%s", command);
		const struct bb_monitor_reply r = stage_ask(s, m, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0);
		const uint16_t truth = stage_truth(s, 0, BB_VCP_LUMINANCE, &has);
		printf("10=%-3u by ddcutil %20u %10u\n", values[i], r.current, truth);
		check(r.current == values[i] && truth == values[i], command);
		const uint16_t other = (uint16_t)(100 - values[i]);
		check(stage_ask(s, m, BB_MONITOR_SET, BB_VCP_CONTRAST, other).status == BB_OK, "our write");
		snprintf(command, sizeof(command), "ddcutil --bus %s --terse getvcp 12 2>&1", number);
		const long theirs = value_of(run("%s", command), BB_VCP_CONTRAST);
		printf("12=%-3u by blackburst %17ld %10u\n", other, theirs, stage_truth(s, 0, BB_VCP_CONTRAST, &has));
		check(theirs == other, command);
	}
}

static void judge_capabilities(struct stage *s, struct bb_monitor *m, const char *number)
{
	static struct vcp_capabilities c;
	const struct bb_monitor_reply r = stage_ask(s, m, BB_MONITOR_CAPABILITIES, 0, 0);
	char ours[BB_MONITOR_TEXT_MAX + 1], feature[32];
	size_t listed = 0;

	NEED(r.status == BB_OK && vcp_capabilities_parse(r.text, r.text_bytes, &c) == BB_OK);
	memcpy(ours, r.text, r.text_bytes);
	ours[r.text_bytes] = '\0';
	const char *raw = run("ddcutil --bus %s --terse capabilities 2>&1", number);
	check(strstr(raw, ours) != NULL, "capabilities, as ddcutil had them from the bus");
	const char *text = run("ddcutil --bus %s capabilities 2>&1", number);
	for (unsigned int code = 0; code < 256; code++) {
		snprintf(feature, sizeof(feature), "Feature: %02X", code);
		listed += strstr(text, feature) != NULL;
		check((strstr(text, feature) != NULL) == c.code[code].known, feature);
	}
	check(listed == c.n_codes && listed > 10, "number of features in the capabilities");
	printf("capabilities: %zu bytes, %zu features, the same by ddcutil and blackburst\n", r.text_bytes, listed);
}

static void judge_detect(struct stage *s, struct bb_monitor *m, const char *bus)
{
	const struct bb_monitor_reply r = stage_ask(s, m, BB_MONITOR_EDID, 0, 0);
	struct edid_info e;
	char want[64];

	NEED(r.status == BB_OK && edid_parse(r.edid, r.edid_bytes, &e) == BB_OK);
	const char *text = run("ddcutil %s 2>&1", "detect --verbose");
	check(strstr(text, bus) != NULL, "detect: the bus");
	snprintf(want, sizeof(want), "%s", e.maker);
	check(strstr(text, want) != NULL, "detect: the maker");
	check(strstr(text, e.name) != NULL, "detect: the model");
	check(strstr(text, e.serial_text) != NULL, "detect: the serial");
	check(strstr(text, "2.2") != NULL, "detect: MCCS 2.2");
	check(!strstr(text, "Invalid display"), "detect: a valid display");
	printf("detect: %s %s %s on %s\n", e.maker, e.name, e.serial_text, bus);
}

/* As it came over the bus. */
static void judge_edid(struct stage *s, size_t i)
{
	char bus[64], line[96];

	stage_plug(s, i, bus, sizeof(bus));
	struct bb_monitor *m = stage_open_bus(s, bus);
	const struct bb_monitor_reply r = stage_ask(s, m, BB_MONITOR_EDID, 0, 0);
	bb_monitor_close(m);
	farm_unplug(s->farm, i);
	FILE *f = fopen("/tmp/edid", "wb");
	NEED(f && fwrite(r.edid, 1, r.edid_bytes, f) == r.edid_bytes && fclose(f) == 0);
	const char *text = run("edid-decode --check %s 2>&1 || true", "/tmp/edid");
	const bool pass = strstr(text, "\nEDID conformity: PASS\n") != NULL;
	snprintf(line, sizeof(line), "edid-decode: %s, %zu bytes", s->farm->monitor[i].usb.config.edid, r.edid_bytes);
	printf("%s: %s\n", line, pass ? "PASS" : text);
	check(pass, line);
}

int main(void)
{
	struct stage s = { 0 };
	char bus[64];

	stage_begin(&s);
	stage_add(&s, "first", "S27A850D");
	stage_plug(&s, 0, bus, sizeof(bus));
	const char *number = strrchr(bus, '-') + 1;
	struct bb_monitor *m = stage_open_bus(&s, bus);
	judge_detect(&s, m, bus);
	judge_values(&s, m, number);
	judge_writes(&s, m, number);
	judge_capabilities(&s, m, number);
	bb_monitor_close(m);
	farm_unplug(s.farm, 0);
	const struct sim_edid_model *model;
	for (size_t i = 0; (model = sim_edid_model_at(i)); i++)
		judge_edid(&s, stage_add(&s, model->name, model->name));
	check(stage_counts(&s, 0).saves == 0, "nothing was saved");
	stage_end(&s);
	printf("{\"test\":\"ddc_judges\",\"compared\":%d,\"different\":%d}\n", compared, wrong);
	return wrong != 0;
}
