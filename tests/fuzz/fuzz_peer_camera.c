/*
 * tests/fuzz/fuzz_peer_camera.c: what a host writes to a simulated camera, which `serve` puts on USB/IP. Byte 0: its
 * options. Then a byte a transfer: the low 4 bits are a command's length, or 15: a read; its bytes follow. From E0 on
 * it is something that happens to the camera.
 */
#include "drivers/trackir_wire.h"
#include "hal/camera_driver.h"
#include "sim/peer_camera.h"
#include "tests/fuzz/fuzz.h"

/* A camera that sees a blob in its first frame and none later, and has another frame mostly whenever it is asked. */
struct model {
	struct bb_camera base;
	bool runs, lost;
	uint32_t seq;
};

static enum bb_status model_open(struct bb_camera *cam, const struct bb_open *open)
{
	(void)cam;
	(void)open;
	return BB_OK;
}

static void model_close(struct bb_camera *cam)
{
	(void)cam;
}

static enum bb_status model_start(struct bb_camera *cam)
{
	bb_container_of(cam, struct model, base)->runs = true;
	return BB_OK;
}

static enum bb_status model_stop(struct bb_camera *cam)
{
	bb_container_of(cam, struct model, base)->runs = false;
	return BB_OK;
}

static enum bb_status model_read(struct bb_camera *cam, struct bb_camera_frame *f)
{
	struct model *m = bb_container_of(cam, struct model, base);

	if (m->lost)
		return BB_ERR_LOST;
	if (!m->runs || m->seq % 4 == 3) {
		m->seq++;
		return BB_TIMEOUT;
	}
	f->seq = m->seq++;
	f->mid_exposure = (struct bb_dev_ns){ f->seq * INT64_C(10000000) };
	f->arrived_ns = f->seq * INT64_C(10000000) + 1;
	f->blobs[0] = (struct bb_blob){ .x_px = 12, .y_px = 3, .area_px = 4 };
	f->n = f->seq == 0; /* drawing one costs more than all the rest */
	return BB_OK;
}

static enum bb_status model_expose(struct bb_camera *cam, int64_t exposure_ns, int64_t offset_ns)
{
	(void)cam;
	fuzz_must(exposure_ns > 0 && exposure_ns <= 0xFFFF * (int64_t)TRACKIR_LINE_NS && offset_ns >= 0);
	return BB_OK;
}

static void happen(struct peer_camera *p, struct model *m, int what, uint32_t n)
{
	switch (what) {
	case 0:
		peer_camera_world_stall(p, n);
		break;
	case 1:
		peer_camera_world_cut(p, n);
		break;
	case 2:
		peer_camera_world_damage(p, n);
		break;
	case 3:
		peer_camera_world_drop(p, n);
		break;
	case 4:
		peer_camera_world_mute(p, n);
		break;
	default:
		m->lost = n;
		break;
	}
}

/* The cameras are made once for each set of options; a reset and these commands put them back. */
static struct sim_usb_device *camera(uint8_t options, struct peer_camera **peer, struct model **m)
{
	static const struct bb_camera_ops ops = { model_open, model_close, model_start,
						  model_stop, model_read,  model_expose };
	static const uint8_t high[6] = { TRACKIR_CMD_REGISTER, TRACKIR_REGISTER_SENSOR, TRACKIR_EXPOSURE_HIGH };
	static struct model models[4];
	static struct peer_camera *peers[4];
	const uint8_t k = options & 3;

	models[k].base.ops = &ops;
	if (!peers[k]) {
		const struct peer_camera_options o = {
			.serial = "S", .stamped = k & 1, .needs_reload = k & 1, .most_in_bytes = k & 2 ? 5 : 0
		};
		fuzz_must(peer_camera_create(&models[k].base, &o, &peers[k]) == BB_OK);
	}
	struct sim_usb_device *dev = peer_camera_usb(peers[k]);
	for (int what = 0; what <= 5; what++)
		happen(peers[k], &models[k], what, 0);
	(void)!dev->ops->present(dev);
	sim_usb_reset(dev);
	(void)sim_usb_transfer(dev, TRACKIR_ENDPOINT_OUT, fuzz_exact(high, sizeof(high)), sizeof(high));
	(void)sim_usb_transfer(dev, TRACKIR_ENDPOINT_OUT, fuzz_exact(&(uint8_t){ TRACKIR_CMD_FPGA_INIT }, 1), 1);
	if (!(options & 4)) /* firmware of no bytes */
		(void)sim_usb_transfer(dev, TRACKIR_ENDPOINT_OUT,
				       fuzz_exact((const uint8_t[]){ TRACKIR_CMD_FIRMWARE, 0 }, 2), 2);
	models[k].seq = 0;
	*peer = peers[k];
	*m = &models[k];
	return dev;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static uint8_t reply[512];
	struct fuzz_input in = { data, size };
	struct peer_camera *peer;
	struct model *m;

	if (!size)
		return 0;
	struct sim_usb_device *dev = camera(fuzz_byte(&in), &peer, &m);
	while (in.left) {
		const uint8_t how = fuzz_byte(&in);
		if (how >= 0xE0) {
			happen(peer, m, how >> 2 & 7, how & 3);
			continue;
		}
		const uint8_t endpoint = how & 0x20         ? how
					 : (how & 15) == 15 ? TRACKIR_ENDPOINT_IN
							    : TRACKIR_ENDPOINT_OUT;
		size_t n = how & 0x10 ? 62 : how & 15;
		if (endpoint & 0x80) {
			const int got = sim_usb_transfer(dev, endpoint, reply, sizeof(reply));
			fuzz_must(got >= SIM_USB_GONE && got <= (int)sizeof(reply));
		} else {
			const uint8_t *bytes = fuzz_piece(&in, n, &n);
			const int took = sim_usb_transfer(dev, endpoint, (uint8_t *)bytes, n);
			fuzz_must(took == SIM_USB_STALL || took == SIM_USB_NAK || took == (int)n);
		}
	}
	return 0;
}
