// Finds the work item of an instance's chunk. The including file declares the buffers.
const uint NO_WORK_ITEM = 0xFFFFFFFF;  // the chunk was culled

// The work item of chunk `chunk` of an instance, or NO_WORK_ITEM if it was culled.
uint work_item_of(uint instance, uint chunk) {
    uint candidate = candidate_offsets[instance] + chunk;
    bool tested = instance_chunks[instance] != 0 && candidate < counters[COUNTER_CANDIDATES];
    candidate = tested ? candidate : 0;
    bool drawn = tested && candidate_visible[candidate] != 0;
    uint w = work_offsets[candidate];
    return drawn && w < counters[COUNTER_WORK_ITEMS] ? w : NO_WORK_ITEM;
}
