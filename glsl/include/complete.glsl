// True if all buffers were large enough for a frame that was submitted as one depth slab a layer, up to this layer. The
// including file declares `counters`; `capacities` are the candidates and work items that fit.
bool is_complete(uvec2 capacities) {
    uvec2 needed = uvec2(counters[COUNTER_CANDIDATES_NEEDED], counters[COUNTER_WORK_ITEMS_NEEDED]);
    bool fits = all(lessThanEqual(needed, capacities)) && counters[COUNTER_SLAB_END] >= counters[COUNTER_VISIBLE];
    return fits && counters[COUNTER_INCOMPLETE] == 0;
}
