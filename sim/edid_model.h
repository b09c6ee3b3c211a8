/*
 * sim/edid_model.h: writes EDIDs: an EDID 1.4 base block, and a CTA-861 extension for models that have one, from a
 * model's data and a mode. The detailed timing is CVT with reduced blanking (version 1). Pure; pixels, Hz, mm.
 */
#ifndef BB_SIM_EDID_MODEL_H
#define BB_SIM_EDID_MODEL_H

#include "hal/cvt.h"
#include "hal/rate.h"
#include "hal/status.h"

struct sim_edid_model {
	const char *name;      /* as room files write it */
	const char *shown;     /* descriptor FC, at most 13 characters */
	char maker[4];
	uint16_t product;
	int width_px, height_px, rate_hz; /* native */
	int width_mm, height_mm;
	uint8_t input;         /* byte 20: depth and interface */
	bool cta;              /* has a CTA extension */
	uint16_t year;
	double peak_cd_m2;     /* white at brightness 100 when warm */
	double chroma[4][2];   /* red, green, blue, white: CIE x, y */
};

/* The model of that name; the generic one (the last, name "generic") for "", NULL and unknown names. */
const struct sim_edid_model *sim_edid_model(const char *name);
/* Row i of the table, NULL past the end. */
const struct sim_edid_model *sim_edid_model_at(size_t i);

struct sim_edid_spec {
	const struct sim_edid_model *model;
	int width_px, height_px;
	struct bb_rate rate;
	uint32_t serial;       /* below 10^7: it also fills the serial text */
	bool stereo;           /* field sequential, left image while stereo sync is 1 */
};

#define SIM_EDID_MAX_BYTES 256
/* Writes 128 or 256 bytes. */
BB_MUST_CHECK enum bb_status sim_edid_make(const struct sim_edid_spec *spec, uint8_t out[SIM_EDID_MAX_BYTES],
                                           size_t *n_out);

#endif
