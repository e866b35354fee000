/* Ambient occlusion through the hierarchy: a dome for some neighbours.  Where
 * it holds nothing, all is open; else the rays start from what it holds. */
#include "shadow_group.h"

/* A dome is for about so many rays; of points whose normals are alike. */
enum { DOME_RAYS = 64, MOST_NODES = 4 };
#define MOST_SPREAD 0.25f

static vocc_status shade_points(const vocc_beaming *w, const uint16_t *which,
                                size_t count)
{
    vocc_lighting *g = w->g;
    vocc_beam *b = &w->room->beam;
    vocc_dome *d = &w->room->dome;
    const uint64_t before = b->nodes + b->clusters;
    vocc_status status;
    vocc_beam_set_dome(b, d, g->t->point, g->t->normal, which, count,
                       g->light->distance);
    if (count > 1 && d->spread > MOST_SPREAD) {
        status = shade_points(w, which, count / 2);
        return status == VOCC_OK
                   ? shade_points(w, which + count / 2, count - count / 2)
                   : status;
    }
    w->counters->beams++;
    d->most_nodes = MOST_NODES;
    d->occluders = g->s->query.occluders && g->target.region == 0;
    w->kernels->raise_dome(b, d);
    status = vocc_shadow_poll(g, 1 + (b->nodes + b->clusters - before) /
                                         VOCC_STEPS_LIKE_A_RAY);
    if (status != VOCC_OK)
        return status;
    if (!d->count)
        return vocc_shadow_settle(g, which, count, 0,
                                  &w->counters->beam_lit_rays);
    g->dome = d;
    status = vocc_shadow_trace(g, which, count, 0);
    g->dome = NULL;
    return status;
}

vocc_status vocc_shadow_domes(const vocc_beaming *w)
{
    const vocc_lit_tile *l = w->light;
    vocc_lighting *g = w->g;
    const size_t few = DOME_RAYS / g->s->pattern.samples,
                 most = few < 1                  ? 1
                        : few < VOCC_DOME_POINTS ? few
                                                 : VOCC_DOME_POINTS;
    vocc_status status = VOCC_OK;
    size_t i;
    if (!vocc_beam_limit_domes(&w->room->beam, g->t->reach))
        return vocc_shadow_trace(g, l->which, l->count, 0);
    for (i = 0; i < l->count && status == VOCC_OK; i += most)
        status = shade_points(w, &l->which[i],
                              l->count - i < most ? l->count - i : most);
    return status;
}
