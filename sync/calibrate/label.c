/* sync/calibrate/label.c: see label.h. */
#include "sync/calibrate/label.h"

#include <math.h>

#define BLOBS_MAX BB_SEQUENCE_BLOBS_MAX
#define SHORTEST_PX 10.0
#define OFF_LINE_PX 1.5    /* of a blob, and what a rough lens bends, */
#define OFF_LINE_SHARE 0.02 /* of the length */
#define PERSPECTIVE 0.13   /* how far the middle may be from where it is seen square on, as a share of the length */
#define HALF 0.49          /* nearer to the middle than this the ends cannot be told apart */

struct flat { /* undistorted places in pixels of the focal length */
	double x, y;
	bool ok;
};

static void flatten(const struct bb_lens *lens, const float (*px)[2], size_t n, struct flat *out)
{
	for (size_t i = 0; i < n; i++) {
		struct bb_ray ray;
		out[i].ok = bb_lens_ray(lens, (double)px[i][0], (double)px[i][1], &ray);
		if (!out[i].ok)
			continue;
		double c[3];
		for (int k = 0; k < 3; k++)
			c[k] = lens->r[k][0] * ray.d.x + lens->r[k][1] * ray.d.y + lens->r[k][2] * ray.d.z;
		out[i].x = lens->fx_px * c[0] / c[2];
		out[i].y = lens->fy_px * c[1] / c[2];
	}
}

/* Is b between a and c, at about `share` of the way? */
static bool is_line(const struct flat *a, const struct flat *b, const struct flat *c, double share)
{
	if (!a->ok || !b->ok || !c->ok)
		return false;
	const double dx = c->x - a->x, dy = c->y - a->y, length = hypot(dx, dy);
	if (!(length > SHORTEST_PX))
		return false;
	const double ux = dx / length, uy = dy / length, bx = b->x - a->x, by = b->y - a->y;
	const double at = (bx * ux + by * uy) / length, off = fabs(bx * uy - by * ux);
	return off < OFF_LINE_PX + OFF_LINE_SHARE * length && at < HALF && fabs(at - share) < PERSPECTIVE;
}

/* Every ordered triple that is such a line; returns how many, and the last one. */
static int lines(const struct flat *f, size_t n, double share, int (*out)[3], int cap)
{
	int found = 0;

	for (size_t a = 0; a < n; a++)
		for (size_t c = 0; c < n; c++)
			for (size_t b = 0; b < n && a != c; b++)
				if (b != a && b != c && is_line(&f[a], &f[b], &f[c], share)) {
					if (found < cap) {
						out[found][0] = (int)a;
						out[found][1] = (int)b;
						out[found][2] = (int)c;
					}
					found++;
				}
	return found;
}

bool bb_label_wand(const struct bb_lens *lens, const struct bb_sequence *s, const float (*px)[2], size_t n, int out[3])
{
	struct flat f[BLOBS_MAX];
	int line[1][3];

	if (n < 3 || n > BLOBS_MAX)
		return false;
	flatten(lens, px, n, f);
	if (lines(f, n, s->along_m[1] / s->along_m[2], line, 1) != 1)
		return false;
	for (int i = 0; i < 3; i++)
		out[i] = line[0][i];
	return true;
}

bool bb_label_square(const struct bb_lens *lens, const struct bb_sequence *s, const float (*px)[2], size_t n, int out[4])
{
	const double far = bb_vec3_norm(bb_vec3_sub(s->square[3], s->square[0]));
	const double share = bb_vec3_norm(bb_vec3_sub(s->square[2], s->square[0])) / far;
	const double arm = bb_vec3_norm(bb_vec3_sub(s->square[1], s->square[0])) / far;
	/* seen from above, which side of the long arm the short one is on */
	const struct bb_vec3 up = bb_vec3_cross(bb_vec3_sub(s->square[1], s->square[0]), bb_vec3_sub(s->square[3], s->square[0]));
	const double side = up.y < 0 ? -1 : 1;
	struct flat f[BLOBS_MAX];
	int line[8][3], found = 0;

	if (n < 4 || n > BLOBS_MAX)
		return false;
	flatten(lens, px, n, f);
	const int n_lines = lines(f, n, share, line, 8);
	for (int i = 0; i < n_lines && i < 8; i++)
		for (int k = 0; k < (int)n; k++) {
			const int *l = line[i];
			if (k == l[0] || k == l[1] || k == l[2] || !f[k].ok)
				continue;
			const double ax = f[l[2]].x - f[l[0]].x, ay = f[l[2]].y - f[l[0]].y;
			const double bx = f[k].x - f[l[0]].x, by = f[k].y - f[l[0]].y, length = hypot(ax, ay);
			/* the short arm is on its side of the long one, and neither foreshortened away nor far too long */
			if (side * (ax * by - ay * bx) < 0.05 * arm * length * length || hypot(bx, by) > 6 * arm * length)
				continue;
			out[0] = l[0];
			out[1] = k;
			out[2] = l[1];
			out[3] = l[2];
			found++;
		}
	return found == 1;
}
