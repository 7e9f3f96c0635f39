// WebGPU: a stable radix sort of splats by their keys, one pass of 8 bits. A work-group has a block of 4096 keys, in rounds of 256.

struct Pass {
  count: u32,   // number of keys
  shift: u32,   // of the digit
  blocks: u32,  // number of work-groups
  first: u32,   // 1 = values are places, and are not read
}

@group(0) @binding(0) var<uniform> u: Pass;
@group(0) @binding(1) var<storage, read> keys_in: array<u32>;
@group(0) @binding(2) var<storage, read> values_in: array<u32>;
@group(0) @binding(3) var<storage, read_write> keys_out: array<u32>;
@group(0) @binding(4) var<storage, read_write> values_out: array<u32>;
@group(0) @binding(5) var<storage, read_write> counts: array<u32>;  // by digit and block

const DIGITS = 256u;
const ROUNDS = 16u;
const WORDS = 8u;  // bits for 256 threads

var<workgroup> histogram: array<atomic<u32>, 256>;
var<workgroup> sums: array<u32, 256>;
var<workgroup> starts: array<u32, 256>;
var<workgroup> members: array<atomic<u32>, 2048>;  // by digit: which threads have it, one bit each

fn digit_of(key: u32) -> u32 {
  return (key >> u.shift) & (DIGITS - 1);
}

// How often each digit occurs in each block.
@compute @workgroup_size(256)
fn count_digits(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) t: u32) {
  atomicStore(&histogram[t], 0u);
  workgroupBarrier();
  for (var round = 0u; round < ROUNDS; round++) {
    let i = (group.x * ROUNDS + round) * DIGITS + t;
    if (i < u.count) { atomicAdd(&histogram[digit_of(keys_in[i])], 1u); }
  }
  workgroupBarrier();
  counts[t * u.blocks + group.x] = atomicLoad(&histogram[t]);
}

// Where the keys of each digit and block begin: one work-group, a thread for each digit.
@compute @workgroup_size(256)
fn sum_counts(@builtin(local_invocation_index) t: u32) {
  var total = 0u;
  for (var block = 0u; block < u.blocks; block++) { total += counts[t * u.blocks + block]; }
  sums[t] = total;
  workgroupBarrier();
  for (var step = 1u; step < DIGITS; step *= 2) {
    var before = 0u;
    if (t >= step) { before = sums[t - step]; }
    workgroupBarrier();
    sums[t] += before;
    workgroupBarrier();
  }
  var at = sums[t] - total;
  for (var block = 0u; block < u.blocks; block++) {
    let here = counts[t * u.blocks + block];
    counts[t * u.blocks + block] = at;
    at += here;
  }
}

// Moves keys and values to their places; those of a digit keep their order.
@compute @workgroup_size(256)
fn scatter(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) t: u32) {
  starts[t] = counts[t * u.blocks + group.x];
  for (var word = 0u; word < WORDS; word++) { atomicStore(&members[WORDS * t + word], 0u); }
  workgroupBarrier();
  for (var round = 0u; round < ROUNDS; round++) {
    let i = (group.x * ROUNDS + round) * DIGITS + t;
    let is_there = i < u.count;
    var key = 0u;
    if (is_there) {
      key = keys_in[i];
      atomicOr(&members[WORDS * digit_of(key) + t / 32], 1u << (t % 32));
    }
    workgroupBarrier();
    if (is_there) {
      let first = WORDS * digit_of(key);
      var to = starts[digit_of(key)] + countOneBits(atomicLoad(&members[first + t / 32]) & ((1u << (t % 32)) - 1));
      for (var word = 0u; word < t / 32; word++) { to += countOneBits(atomicLoad(&members[first + word])); }
      keys_out[to] = key;
      if (u.first == 1) { values_out[to] = i; } else { values_out[to] = values_in[i]; }
    }
    workgroupBarrier();
    for (var word = 0u; word < WORDS; word++) {
      starts[t] += countOneBits(atomicExchange(&members[WORDS * t + word], 0u));
    }
    workgroupBarrier();
  }
}
