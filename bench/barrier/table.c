#include "bench/barrier/table.h"

#include <stdlib.h>

const char *bb_lock_method_text(enum bb_lock_method m)
{
	static const char *const names[BB_LOCK_METHODS] = { "central", "tree", "dissemination", "timed" };

	return names[m];
}

static enum bb_status run_row(const struct bb_barrier_table *t, struct bb_barrier_row *row)
{
	struct bb_troupe_config c = t->usual;
	struct bb_troupe *w;

	c.method = row->method;
	c.n_nodes = row->n_nodes;
	c.link.loss_ppm = row->loss * 1e6;
	row->skew_model_us = bb_barrier_skew_us(row->method, &t->net, row->n_nodes, 0.5);
	row->cost_model_us = row->method == BB_LOCK_TIMED ? 0 : bb_barrier_cost_us(row->method, &t->net, row->n_nodes);
	row->messages_model = bb_barrier_messages(row->method, row->n_nodes);
	const enum bb_status status = bb_troupe_create(&c, &w);
	if (status != BB_OK)
		return status;
	/* A frame that stalls takes some periods: what does not end in this time stands still. */
	const uint64_t last = c.settle_frames + c.frames;
	const bool ended = bb_troupe_run(w, last, (int64_t)last * 8 * bb_rate_period_ns(c.rate));
	row->result = bb_troupe_result(w);
	row->ended = ended;
	bb_troupe_destroy(w);
	return BB_OK;
}

static void plan_rows(struct bb_barrier_table *t)
{
	struct bb_barrier_row *row = t->rows;

	for (size_t i = 0; i < t->n_sizes; i++)
		for (int m = 0; m < BB_LOCK_METHODS; m++)
			*row++ = (struct bb_barrier_row){ .n_nodes = t->sizes[i], .method = (enum bb_lock_method)m };
	for (size_t i = 0; i < BB_BARRIER_LOSS_SIZES; i++)
		for (size_t k = 0; k < t->n_losses && t->loss_sizes[i]; k++)
			for (int m = 0; m < BB_LOCK_METHODS; m++)
				*row++ = (struct bb_barrier_row){ .n_nodes = t->loss_sizes[i], .loss = t->losses[k],
					                          .method = (enum bb_lock_method)m };
	t->n_rows = (size_t)(row - t->rows);
}

enum bb_status bb_barrier_table_run(struct bb_barrier_table *t)
{
	char text[80];

	t->rows = calloc((t->n_sizes + BB_BARRIER_LOSS_SIZES * t->n_losses) * BB_LOCK_METHODS + 1, sizeof(*t->rows));
	if (!t->rows)
		return BB_ERR_NOMEM;
	plan_rows(t);
	for (size_t i = 0; i < t->n_rows; i++) {
		struct bb_barrier_row *row = &t->rows[i];
		snprintf(text, sizeof(text), "%s, %u endpoints, %.3g %% lost", bb_lock_method_text(row->method), row->n_nodes,
		         row->loss * 100);
		if (t->progress)
			t->progress(text);
		const enum bb_status status = run_row(t, row);
		if (status != BB_OK)
			return status;
	}
	return BB_OK;
}

void bb_barrier_table_release(struct bb_barrier_table *t)
{
	free(t->rows);
	t->rows = NULL;
	t->n_rows = 0;
}

const struct bb_barrier_row *bb_barrier_row(const struct bb_barrier_table *t, size_t size, enum bb_lock_method m)
{
	return &t->rows[size * BB_LOCK_METHODS + m];
}

const struct bb_barrier_row *bb_barrier_loss_row(const struct bb_barrier_table *t, size_t size, size_t loss,
                                                 enum bb_lock_method m)
{
	return &t->rows[(t->n_sizes + size * t->n_losses + loss) * BB_LOCK_METHODS + m];
}

/* ---- crossovers ---- */

unsigned bb_barrier_crossover(const struct bb_barrier_table *t, enum bb_lock_method better, enum bb_lock_method than, bool cost)
{
	unsigned from = 0;

	for (size_t i = 0; i < t->n_sizes; i++) {
		const struct bb_troupe_result *a = &bb_barrier_row(t, i, better)->result, *b = &bb_barrier_row(t, i, than)->result;
		const bool less = cost ? a->cost.p50 < b->cost.p50 : a->skew.p50 < b->skew.p50;
		from = !less ? 0 : from ? from : t->sizes[i];
	}
	return from;
}

static double modelled(const struct bb_barrier_table *t, enum bb_lock_method m, unsigned n, bool cost)
{
	return cost ? bb_barrier_cost_us(m, &t->net, n) : bb_barrier_skew_us(m, &t->net, n, 0.5);
}

unsigned bb_barrier_crossover_model(const struct bb_barrier_table *t, enum bb_lock_method better, enum bb_lock_method than,
                                    bool cost)
{
	unsigned most = 2, from = 0;

	for (size_t i = 0; i < t->n_sizes; i++)
		most = t->sizes[i] > most ? t->sizes[i] : most;
	/* From above: below the crossover the other is better. A step is a hundredth: the model costs n operations each. */
	for (unsigned n = most; n >= 2 && modelled(t, better, n, cost) < modelled(t, than, n, cost); n -= n / 100 + 1)
		from = n;
	return from;
}
