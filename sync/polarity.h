/*
 * sync/polarity.h: does each eye get its own picture, and if not, since when? Positive identity only: a source says whose
 * picture is there at an eye change, and that is compared with the eye the glasses open for. Sources:
 *   LEVEL    the stereo level that came with the edge (VESA: high is left)
 *   COUNTER  the parity of a counter that came with it (CANopen SYNC), even is left
 *   MSC      the parity of the display's vblank counter, where even vblanks show the left eye
 *   TAG      an optical tag in the picture (hal/optics.h), read from light
 * Row G8: two eye changes in a row that disagree are a flip, reported with the time of the first; one alone is a glitch.
 * It holds again after ten frames of agreement. Where nothing tells eyes nobody can know: untagged, which means mono and
 * an alarm, and so does a source that falls silent. What is shown meanwhile is the caller's affair.
 * A run feeds LEVEL only: the eyes of the chain's edges (bench/loop/shutters.c). MSC and TAG, with the reader below, are
 * for a program that has such a source while it runs; light is measured after the fact here (blackburst phase measure).
 * Pure; one observation an eye change and source, in order of time per source. One thread.
 */
#ifndef BB_SYNC_POLARITY_H
#define BB_SYNC_POLARITY_H

#include "hal/optics.h"

enum bb_polarity_source { BB_POLARITY_LEVEL, BB_POLARITY_COUNTER, BB_POLARITY_MSC, BB_POLARITY_TAG, BB_POLARITY_SOURCES };
enum bb_polarity_verdict {
	BB_POLARITY_UNKNOWN,  /* not two changes seen yet */
	BB_POLARITY_HOLDS,
	BB_POLARITY_FLIPPED,  /* each eye sees the other one's picture */
	BB_POLARITY_UNTAGGED  /* nothing tells: show mono */
};

struct bb_polarity {
	int64_t period_ns;            /* of eye changes */
	enum bb_polarity_verdict verdict;
	enum bb_polarity_source by;   /* FLIPPED: the source that saw it first */
	int64_t flipped_ns;           /* FLIPPED: when the first picture of the wrong eye was there */
	int64_t known_ns;             /* when anything last told an eye */
	unsigned silent;              /* eye changes in a row of which nothing told */
	uint64_t flips, glitches;     /* since init */
	struct {
		unsigned bad, good;       /* in a row */
		int64_t bad_ns;           /* when this row of bad ones began */
	} source[BB_POLARITY_SOURCES];
};

void bb_polarity_init(struct bb_polarity *p, struct bb_rate rate);
/* picture NONE: this source cannot tell for this change; glasses NONE: they are open for both. */
enum bb_polarity_verdict bb_polarity_see(struct bb_polarity *p, enum bb_polarity_source source, int64_t at_ns,
                                         enum bb_eye picture, enum bb_eye glasses);

/* An optical tag from the mean light of one frame after another, in any unit: whose frame was it, and where in the tag's
 * count. Learns black and white by itself from the first frames. */
struct bb_tag_reader {
	double low, high;             /* seen lately */
	unsigned n, bits, n_bits;
	int place;                    /* of the newest right frame: 0..30, -1: not known yet */
	bool gap;                     /* it did not follow the one before: frames are missing */
};
void bb_tag_reader_init(struct bb_tag_reader *r);
enum bb_eye bb_tag_reader_frame(struct bb_tag_reader *r, double light);

#endif
