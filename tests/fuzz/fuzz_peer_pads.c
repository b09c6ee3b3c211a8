/*
 * tests/fuzz/fuzz_peer_pads.c: what a host writes to simulated gamepads on USB and on an Xbox receiver's slots. A byte
 * a transfer: bits 0 to 2 which device; bits 3 and 4: a control transfer (a SETUP packet follows), a write (its
 * endpoint follows), a read (likewise), a report by SET_REPORT; bits 5 to 7: how many times 8 bytes follow at most.
 * Device 7 is the world: one of them is pulled out or plugged in.
 */
#include "sim/peer_pads_impl.h"
#include "tests/fuzz/fuzz.h"

struct bench {
	struct sim_peer_pad *pad[SIM_PEER_KINDS];
	struct sim_xbox_receiver receiver;
	struct bb_clock *clk; /* never runs: nobody's hand moves */
};

static void build(struct bench *b)
{
	fuzz_must(bb_clock_virtual_create(&b->clk) == BB_OK);
	for (int kind = 0; kind < SIM_PEER_KINDS; kind++) {
		const struct sim_peer_config c = {
			.kind = (enum sim_peer_kind)kind, .id = "p", .script = "", .clk = b->clk
		};
		fuzz_must(sim_peer_pad_create(&c, &b->pad[kind]) == BB_OK);
	}
	sim_xbox_init(&b->receiver);
	b->receiver.pad[1] = b->pad[SIM_PEER_XBOX_PAD];
}

/* As fresh from the box. */
static void put_back(struct bench *b)
{
	for (int kind = 0; kind < SIM_PEER_KINDS; kind++) {
		struct sim_peer_pad *p = b->pad[kind];
		sim_peer_pad_unplug(p, false);
		p->fault_off = p->fault_descriptor = false;
		p->n = p->head = 0;
		p->led = -1;
		if (sim_peer_pad_usb(p))
			sim_usb_reset(sim_peer_pad_usb(p));
	}
	sim_usb_reset(&b->receiver.usb);
	memset(b->receiver.asked, 0, sizeof(b->receiver.asked));
}

static struct sim_usb_device *pick(struct bench *b, unsigned int which)
{
	return which < SIM_PEER_XBOX_PAD ? sim_peer_pad_usb(b->pad[which]) : &b->receiver.usb;
}

static void control(struct sim_usb_device *dev, struct fuzz_input *in, size_t want, bool report)
{
	static const uint8_t none[64];
	uint8_t p[8];
	size_t n;

	for (size_t i = 0; i < sizeof(p); i++)
		p[i] = fuzz_byte(in);
	struct bb_usb_setup setup = { .request_type = p[0],
				      .request = p[1],
				      .value = (uint16_t)(p[2] | p[3] << 8),
				      .index = (uint16_t)(p[4] | p[5] << 8),
				      .length = (uint16_t)(p[6] | p[7] << 8) };
	if (report) {
		setup.request_type = 0x21;
		setup.request = 9;
		setup.value = (uint16_t)(0x200 | p[2]);
		setup.length = (uint16_t)want;
	}
	uint8_t *bytes = setup.request_type & 0x80 ? fuzz_exact(none, n = want) : fuzz_piece(in, want, &n);
	const int moved = sim_usb_control(dev, &setup, bytes, n);
	fuzz_must(moved == SIM_USB_STALL || moved == SIM_USB_NAK || (moved >= 0 && moved <= (int)n));
}

static void transfer(struct sim_usb_device *dev, struct fuzz_input *in, size_t want, bool read)
{
	static const uint8_t none[64];
	const uint8_t endpoint = (uint8_t)((fuzz_byte(in) & 0x7F) | (read ? 0x80 : 0));
	size_t n = want;
	uint8_t *bytes = read ? fuzz_exact(none, n) : fuzz_piece(in, want, &n);

	const int moved = sim_usb_transfer(dev, endpoint, bytes, n);
	fuzz_must(moved >= SIM_USB_GONE && moved <= (int)n);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static struct bench b;
	struct fuzz_input in = { data, size };

	if (!b.clk)
		build(&b);
	put_back(&b);
	while (in.left) {
		const uint8_t how = fuzz_byte(&in);
		if ((how & 7) == 7) {
			struct sim_peer_pad *p = b.pad[(how >> 3) % SIM_PEER_KINDS];
			sim_peer_pad_unplug(p, how & 0x80);
			p->fault_descriptor = how & 0x40;
			continue;
		}
		struct sim_usb_device *dev = pick(&b, how & 7);
		size_t want = (size_t)(how >> 5) * 8;
		want -= want ? fuzz_byte(&in) & 7 : 0;
		if ((how >> 3 & 3) == 0 || (how >> 3 & 3) == 3)
			control(dev, &in, want, (how >> 3 & 3) == 3);
		else
			transfer(dev, &in, want, (how >> 3 & 3) == 2);
	}
	for (int kind = 0; kind < SIM_PEER_KINDS; kind++) {
		float strong, weak;
		(void)sim_peer_pad_rumble(b.pad[kind], &strong, &weak);
		fuzz_must(strong >= 0 && strong <= 1 && weak >= 0 && weak <= 1);
		fuzz_must(sim_peer_pad_led(b.pad[kind]) >= -1 && sim_peer_pad_led(b.pad[kind]) <= 15);
	}
	return 0;
}
