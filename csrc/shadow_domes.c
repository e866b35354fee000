/* Ambient occlusion through the hierarchy: a dome for each point.  One that
 * holds nothing is open; of the others the rays start from what it holds. */
#include "shadow_group.h"

enum { MOST_NODES = 16 };

static vocc_status shade_point(const vocc_beaming *w, const uint16_t *which)
{
    vocc_lighting *g = w->g;
    vocc_beam *b = &w->room->beam;
    vocc_dome *d = &w->room->dome;
    const uint64_t before = b->nodes + b->clusters;
    vocc_status status;
    w->counters->beams++;
    vocc_beam_set_dome(b, d, g->t->point[*which], g->t->normal[*which],
                       g->light->distance);
    d->most_nodes = MOST_NODES;
    w->kernels->raise_dome(b, d);
    status = vocc_shadow_poll(g, 1 + (b->nodes + b->clusters - before) /
                                         VOCC_STEPS_LIKE_A_RAY);
    if (status != VOCC_OK)
        return status;
    if (!d->count)
        return vocc_shadow_settle(g, which, 1, 0, &w->counters->beam_lit_rays);
    g->dome = d;
    status = vocc_shadow_trace(g, which, 1, 0);
    g->dome = NULL;
    return status;
}

vocc_status vocc_shadow_domes(const vocc_beaming *w)
{
    const vocc_lit_tile *l = w->light;
    vocc_lighting *g = w->g;
    vocc_status status = VOCC_OK;
    size_t i;
    g->beam = &w->room->beam;
    if (!vocc_beam_limit_domes(g->beam, g->t->reach))
        status = vocc_shadow_trace(g, l->which, l->count, 0);
    else
        for (i = 0; i < l->count && status == VOCC_OK; i++)
            status = shade_point(w, &l->which[i]);
    g->beam = NULL;
    return status;
}
