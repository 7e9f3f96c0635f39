// Offset records of a packed scene (`scene::packed`): f16, or codes of 8 bits between two limits that 256 records share. The
// including file declares the buffers `packed_offset_means` and `offset_ranges`.
layout(constant_id = 11) const uint OFFSET_BITS = 16;  // 16 = f16, 8 = codes; 0 = offsets are not packed

const uint RECORDS_PER_RANGE = 256;  // records that share the limits of their codes
const uint CODED_CHANNELS = 14;      // numbers of a record that are coded: mean, logit, SH 0, log scales, quaternion

// Four 8-bit codes from the lowest byte on, which begin at number `channel` of record `record`: limits are by range, first the
// lower limits of all numbers, then the steps.
vec4 from_codes(uint codes, uint record, uint channel) {
    uint low = 2 * CODED_CHANNELS * (record / RECORDS_PER_RANGE) + channel, size = low + CODED_CHANNELS;
    vec4 steps = vec4(codes & 0xffu, (codes >> 8) & 0xffu, (codes >> 16) & 0xffu, codes >> 24);
    vec4 lows = vec4(offset_ranges[low], offset_ranges[low + 1], offset_ranges[low + 2], offset_ranges[low + 3]);
    vec4 sizes = vec4(offset_ranges[size], offset_ranges[size + 1], offset_ranges[size + 2], offset_ranges[size + 3]);
    return lows + sizes * steps;
}

// The offset of the mean, template frame, and of the opacity logit.
vec4 mean_and_logit_offset(uint record) {
    if (OFFSET_BITS == 8) return from_codes(packed_offset_means[record], record, 0);
    return vec4(unpackHalf2x16(packed_offset_means[2 * record]), unpackHalf2x16(packed_offset_means[2 * record + 1]));
}
