// A candidate: one (instance, chunk) pair of the instances that `cull_instances` kept, and its bounds. The including file declares
// the buffers `instances`, `chunks`, `candidate_offsets`, and `view` and `instance_count`.

// The instance that owns candidate `c`: the last whose offset is <= c (those with zero chunks share offsets and are skipped).
uint owner_of(uint c) {
    uint low = 0;
    uint high = instance_count;
    while (high - low > 1) {
        uint middle = (low + high) / 2;
        bool left = candidate_offsets[middle] > c;
        high = left ? middle : high;
        low = left ? low : middle;
    }
    return low;
}

WorkItem candidate_at(uint c) {
    uint i = owner_of(c);
    return WorkItem(i, c - candidate_offsets[i]);
}

// The ball of the chunk alone.
Reach reach_of(WorkItem candidate) {
    Instance instance = instances[candidate.instance];
    Chunk chunk = chunks[instance.first_chunk + candidate.chunk];
    float radius = chunk.radius + instance.max_offset;
    float sigma = chunk.sigma_max * instance.sigma_growth;
    return reach_of_ball(view, instance.world_from_template, instance.scale, chunk.center, radius, sigma);
}
