#include "sync/track/steady.h"

#include <math.h>

#include "sync/track/filter.h"

struct bb_steady_config bb_steady_usual(struct bb_pose neutral)
{
	return (struct bb_steady_config){ .neutral = neutral,
		                          .decay_ns = 1000000000,
		                          .blend_ns = 200000000,
		                          .consistent = 3,
		                          .apart_ns = 100000000,
		                          .most_m_s = 4, /* a head that is thrown about does 3 and 10 */
		                          .most_rad_s = 12,
		                          .slack_m = 0.01,
		                          .slack_rad = 0.05 };
}

static bool is_pose(const struct bb_pose *p)
{
	const double n = p->q.x * p->q.x + p->q.y * p->q.y + p->q.z * p->q.z + p->q.w * p->q.w;

	return isfinite(p->p.x) && isfinite(p->p.y) && isfinite(p->p.z) && n > 0.5 && n < 2;
}

void bb_steady_init(struct bb_steady *s, const struct bb_steady_config *c)
{
	*s = (struct bb_steady){ .c = *c, .state = BB_STEADY_NEUTRAL, .last = c->neutral, .from = c->neutral };
}

bool bb_steady_note(struct bb_steady *s, int64_t at_ns, const struct bb_pose *eyes)
{
	const double dt_s = s->noted ? bb_seconds_between(at_ns, s->note_ns) : 0;
	const bool in_row = s->noted && dt_s > 0 && dt_s <= (double)s->c.apart_ns * 1e-9;

	if (!is_pose(eyes)) {
		s->agreed = 0;
		return false;
	}
	const bool agrees = in_row && bb_vec3_norm(bb_vec3_sub(eyes->p, s->note.p)) <= s->c.slack_m + s->c.most_m_s * dt_s &&
	                    bb_quat_angle(eyes->q, s->note.q) <= s->c.slack_rad + s->c.most_rad_s * dt_s;
	s->agreed = agrees ? s->agreed + (s->agreed < s->c.consistent) : 1;
	s->noted = true;
	s->note_ns = at_ns;
	s->note = *eyes;
	return agrees || !in_row;
}

static double eased(int64_t done_ns, int64_t all_ns)
{
	const double t = all_ns > 0 ? fmin(1, (double)done_ns / (double)all_ns) : 1;

	return t * t * (3 - 2 * t);
}

static struct bb_pose between(const struct bb_pose *a, const struct bb_pose *b, double t)
{
	return (struct bb_pose){ bb_vec3_lerp(a->p, b->p, t), bb_quat_slerp(a->q, b->q, t) };
}

static void enter(struct bb_steady *s, enum bb_steady_state state)
{
	s->state = state;
	s->from = s->last;
	s->moved_ns = 0;
}

/* What the tracker says now may be shown: it predicts, and enough of what it saw agrees. */
static void choose(struct bb_steady *s, bool predicts)
{
	const bool believed = predicts && s->agreed >= s->c.consistent;

	if (s->state == BB_STEADY_FOLLOW || s->state == BB_STEADY_BLEND) {
		if (predicts)
			return;
		enter(s, BB_STEADY_DECAY);
		s->agreed = 0;
	} else if (believed) {
		enter(s, s->shown ? BB_STEADY_BLEND : BB_STEADY_FOLLOW);
	}
}

static int64_t pause_ns(const struct bb_steady *s, int64_t at_ns)
{
	int64_t dt_ns;

	if (!s->shown || at_ns <= s->at_ns)
		return 0;
	if (__builtin_sub_overflow(at_ns, s->at_ns, &dt_ns) || dt_ns > BB_STEADY_STEP_NS)
		return BB_STEADY_STEP_NS;
	return dt_ns;
}

/* Carries the way on by so much time. */
static struct bb_pose move(struct bb_steady *s, const struct bb_pose *live, int64_t dt_ns)
{
	s->moved_ns += dt_ns;
	if (s->state == BB_STEADY_DECAY && s->moved_ns >= s->c.decay_ns)
		s->state = BB_STEADY_NEUTRAL;
	if (s->state == BB_STEADY_BLEND && s->moved_ns >= s->c.blend_ns)
		s->state = BB_STEADY_FOLLOW;
	switch (s->state) {
	case BB_STEADY_FOLLOW:
		return *live;
	case BB_STEADY_DECAY:
		return between(&s->from, &s->c.neutral, eased(s->moved_ns, s->c.decay_ns));
	case BB_STEADY_BLEND:
		return between(&s->from, live, eased(s->moved_ns, s->c.blend_ns));
	case BB_STEADY_NEUTRAL:
		break;
	}
	return s->c.neutral;
}

struct bb_steady_pose bb_steady_step(struct bb_steady *s, const struct bb_track_pose *tracked, int64_t at_ns)
{
	const bool is = is_pose(&tracked->eyes) && !(tracked->flags & BB_TRACK_NEVER);
	struct bb_steady_pose out = { .age_ns = BB_NEVER, .position_sigma_mm = 1e6 };

	choose(s, is && !(tracked->flags & BB_TRACK_FROZEN));
	s->last = move(s, &tracked->eyes, pause_ns(s, at_ns));
	s->at_ns = at_ns;
	s->shown = true;
	out.eyes = s->last;
	out.state = s->state;
	if (!is)
		return out;
	int64_t age_ns;
	out.age_ns = __builtin_sub_overflow(at_ns, tracked->solved_ns, &age_ns) ? BB_NEVER : age_ns;
	out.position_sigma_mm = hypot(tracked->position_sigma_mm, 1e3 * bb_vec3_norm(bb_vec3_sub(s->last.p, tracked->eyes.p)));
	return out;
}
