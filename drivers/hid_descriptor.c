/* drivers/hid_descriptor.c: see drivers/hid_descriptor.h. Names of items as in the HID 1.11 definition, section 6.2.2.
 */
#include "drivers/hid_descriptor.h"

enum { ITEM_MAIN, ITEM_GLOBAL, ITEM_LOCAL, ITEM_LONG };

struct globals {
	uint16_t usage_page;
	int32_t logical_least, logical_most;
	uint32_t size, count;
	uint8_t report_id;
};

struct walker {
	const uint8_t *bytes;
	size_t n, at, item_at;
	const char *device;
	struct bb_hid_layout *out;
	struct bb_error *err;
	struct globals g, stack[BB_HID_DEPTH_MAX];
	size_t n_pushed, depth;
	bool has_usage, has_ids, has_application;
	uint16_t usage_page, usage_least, usage_most; /* local; the page may differ from the global one */
};

struct item {
	unsigned int type, tag;
	size_t n_data;
	uint32_t u;
	int32_t s;
};

static enum bb_status reject(struct walker *w, const char *why)
{
	return bb_fail(w->err, BB_ERR_FORMAT, 1560, NULL, "%s: DESC_REJECT at byte %zu: %s", w->device, w->item_at,
		       why);
}

static enum bb_status next_item(struct walker *w, struct item *it)
{
	static const uint8_t lengths[4] = { 0, 1, 2, 4 };
	const uint8_t prefix = w->bytes[w->at];

	w->item_at = w->at++;
	*it = (struct item){ .type = prefix >> 2 & 3, .tag = prefix >> 4, .n_data = lengths[prefix & 3] };
	if (prefix == 0xFE) { /* long item: its own length byte; none is defined, all are stepped over */
		if (w->n - w->at < 2 || w->n - w->at - 2 < w->bytes[w->at])
			return reject(w, "a long item past the end");
		w->at += 2u + w->bytes[w->at];
		it->type = ITEM_LONG;
		return BB_OK;
	}
	if (w->n - w->at < it->n_data)
		return reject(w, "an item past the end");
	for (size_t i = 0; i < it->n_data; i++)
		it->u |= (uint32_t)w->bytes[w->at + i] << (8 * i);
	it->s = it->n_data == 1 ? (int8_t)it->u : it->n_data == 2 ? (int16_t)it->u : (int32_t)it->u;
	w->at += it->n_data;
	return BB_OK;
}

static void forget_locals(struct walker *w)
{
	w->has_usage = false;
	w->usage_page = w->usage_least = w->usage_most = 0;
}

static struct bb_hid_report *report_of(struct walker *w, enum bb_hid_way way, uint8_t id)
{
	struct bb_hid_layout *l = w->out;

	for (size_t i = 0; i < l->n_reports; i++)
		if (l->report[i].way == way && l->report[i].id == id)
			return &l->report[i];
	if (l->n_reports == BB_HID_REPORTS_MAX)
		return NULL;
	l->report[l->n_reports] = (struct bb_hid_report){ way, id, 0 };
	return &l->report[l->n_reports++];
}

static enum bb_status add_field(struct walker *w, enum bb_hid_way way, uint32_t flags)
{
	const uint64_t bits = (uint64_t)w->g.size * w->g.count;
	struct bb_hid_report *r = report_of(w, way, w->g.report_id);
	struct bb_hid_layout *l = w->out;

	if (!r)
		return reject(w, "more than 64 reports");
	if (w->g.size > 32 && !(flags & 1))
		return reject(w, "a value of more than 32 bits");
	if (bits > BB_HID_REPORT_BITS_MAX || r->bits + bits > BB_HID_REPORT_BITS_MAX)
		return reject(w, "a report of more than 16384 bytes");
	if (l->n_fields == BB_HID_FIELDS_MAX)
		return reject(w, "more than 1024 fields");
	l->field[l->n_fields++] = (struct bb_hid_field){
		.way = way,
		.report_id = w->g.report_id,
		.constant = flags & 1,
		.variable = flags >> 1 & 1,
		.usage_page = w->usage_page ? w->usage_page : w->g.usage_page,
		.usage_least = w->usage_least,
		.usage_most = w->usage_most,
		.bit_offset = r->bits,
		.bits = w->g.size,
		.count = w->g.count,
		.logical_least = w->g.logical_least,
		.logical_most = w->g.logical_most,
	};
	r->bits += (uint32_t)bits;
	return BB_OK;
}

static enum bb_status begin_collection(struct walker *w, uint32_t kind)
{
	if (w->depth == BB_HID_DEPTH_MAX)
		return reject(w, "collections nested deeper than 16");
	w->depth++;
	if (kind == 1 && !w->has_application) {
		w->has_application = true;
		w->out->usage_page = w->usage_page ? w->usage_page : w->g.usage_page;
		w->out->usage = w->usage_least;
	}
	return BB_OK;
}

static enum bb_status main_item(struct walker *w, const struct item *it)
{
	enum bb_status status = BB_OK;

	switch (it->tag) {
	case 0x8:
		status = add_field(w, BB_HID_INPUT, it->u);
		break;
	case 0x9:
		status = add_field(w, BB_HID_OUTPUT, it->u);
		break;
	case 0xB:
		status = add_field(w, BB_HID_FEATURE, it->u);
		break;
	case 0xA:
		status = begin_collection(w, it->u);
		break;
	case 0xC:
		if (!w->depth)
			return reject(w, "a collection ends that never began");
		w->depth--;
		break;
	default:
		return reject(w, "an unknown main item");
	}
	forget_locals(w);
	return status;
}

static enum bb_status report_id(struct walker *w, uint32_t id)
{
	if (!id || id > 255)
		return reject(w, "a report id that is none");
	if (!w->has_ids && w->out->n_fields)
		return reject(w, "a report id after fields that have none");
	w->has_ids = true;
	w->g.report_id = (uint8_t)id;
	return BB_OK;
}

static enum bb_status global_item(struct walker *w, const struct item *it)
{
	switch (it->tag) {
	case 0x0:
		if (it->u > 0xFFFF)
			return reject(w, "a usage page that is none");
		w->g.usage_page = (uint16_t)it->u;
		return BB_OK;
	case 0x1:
		w->g.logical_least = it->s;
		return BB_OK;
	case 0x2: /* 0x25 0xFF is written where 255 is meant; only a range that begins below 0 is signed */
		w->g.logical_most = w->g.logical_least < 0 || it->u > INT32_MAX ? it->s : (int32_t)it->u;
		return BB_OK;
	case 0x7:
		w->g.size = it->u;
		return BB_OK;
	case 0x8:
		return report_id(w, it->u);
	case 0x9:
		w->g.count = it->u;
		return BB_OK;
	case 0xA:
		if (w->n_pushed == BB_HID_DEPTH_MAX)
			return reject(w, "more than 16 pushes");
		w->stack[w->n_pushed++] = w->g;
		return BB_OK;
	case 0xB:
		if (!w->n_pushed)
			return reject(w, "a pop without a push");
		w->g = w->stack[--w->n_pushed];
		return BB_OK;
	default: /* physical range, unit: nothing here needs them */
		return it->tag <= 0x6 ? BB_OK : reject(w, "an unknown global item");
	}
}

/* The lowest and the highest usage; a list of single ones is kept as the range it spans. */
static void local_item(struct walker *w, const struct item *it)
{
	const uint16_t usage = (uint16_t)it->u;

	if (it->tag > 2) /* designators, strings, delimiters */
		return;
	if (it->n_data == 4)
		w->usage_page = (uint16_t)(it->u >> 16);
	if (!w->has_usage) {
		w->usage_least = w->usage_most = usage;
		w->has_usage = true;
		return;
	}
	if (usage < w->usage_least)
		w->usage_least = usage;
	if (usage > w->usage_most)
		w->usage_most = usage;
}

static enum bb_status walk(struct walker *w)
{
	enum bb_status status = BB_OK;
	struct item it;

	while (w->at < w->n) {
		status = next_item(w, &it);
		if (status == BB_OK && it.type == ITEM_MAIN)
			status = main_item(w, &it);
		else if (status == BB_OK && it.type == ITEM_GLOBAL)
			status = global_item(w, &it);
		else if (status == BB_OK && it.type == ITEM_LOCAL)
			local_item(w, &it);
		if (status != BB_OK)
			return status;
	}
	w->item_at = w->n;
	if (w->depth)
		return reject(w, "a collection does not end");
	return w->out->n_fields ? BB_OK : reject(w, "no field at all");
}

enum bb_status bb_hid_layout_parse(const uint8_t *bytes, size_t n, const char *device, struct bb_hid_layout *out,
				   struct bb_error *err)
{
	struct walker w = { .bytes = bytes, .n = n, .device = device, .out = out, .err = err };

	out->usage_page = out->usage = 0;
	out->n_reports = out->n_fields = 0; /* what lies behind them is never looked at */
	if (n > BB_HID_DESCRIPTOR_BYTES_MAX) {
		w.item_at = BB_HID_DESCRIPTOR_BYTES_MAX;
		return reject(&w, "longer than 4096 bytes");
	}
	return walk(&w);
}

const struct bb_hid_report *bb_hid_layout_report(const struct bb_hid_layout *l, enum bb_hid_way way, uint8_t id)
{
	for (size_t i = 0; i < l->n_reports; i++)
		if (l->report[i].way == way && l->report[i].id == id)
			return &l->report[i];
	return NULL;
}

size_t bb_hid_report_bytes(const struct bb_hid_report *r)
{
	return (r->bits + 7) / 8 + (r->id != 0);
}
