/*
 * hal/budget_read.h: budgets as room and scene files write them: `head_to_photon: {p99_ms: 50, marginal_ms: 45}`, each
 * key <statistic>_<unit>, converted to the metric's own unit.
 */
#ifndef BB_HAL_BUDGET_READ_H
#define BB_HAL_BUDGET_READ_H

#include "hal/metric.h"
#include "hal/room/yaml.h"

/* Read the entry of one metric (its key names the metric) and append its limits. 1101, 1115, 1116, 1117. */
BB_MUST_CHECK enum bb_status bb_budget_read(struct bb_reader *r, const struct bb_yaml_node *entry,
                                            struct bb_budget budgets[BB_BUDGETS_MAX], size_t *n);

#endif
