// Device-side counts of one frame, and the indirect arguments that follow from them.

const uint COUNTER_CANDIDATES = 0;          // (instance, chunk) pairs of visible instances, at most their capacity
const uint COUNTER_WORK_ITEMS = 1;          // pairs that survive the chunk test, at most their capacity
const uint COUNTER_VISIBLE = 2;             // splats that touch at least one tile
const uint COUNTER_SLAB_BEGIN = 3;          // first splat in depth order of the current slab
const uint COUNTER_SLAB_END = 4;            // one past the last splat of the current slab
const uint COUNTER_SLAB_INTERSECTIONS = 5;  // (splat, tile) pairs of the current slab
const uint COUNTER_CANDIDATES_NEEDED = 6;   // candidates before limiting to the capacity (saturating)
const uint COUNTER_WORK_ITEMS_NEEDED = 7;   // work items before limiting to the capacity (saturating)
const uint COUNTER_INTERSECTIONS = 8;       // pairs from the current slab's begin to the last splat (saturating)
const uint COUNTER_INSTANCES = 9;           // instances of the scene, background included: set by the host
const uint COUNTER_LAYER = 10;              // depth layer that is drawn, 0 for the frontmost: set by the host
const uint COUNTER_LAST_LAYER = 11;         // last depth layer of the frame, 0 for a frame in one piece: set by the host
const uint COUNTER_LAYER_BEGIN = 12;        // bits of the depths at which the LAYERS layers begin, and of the end of the last
const uint COUNTER_INCOMPLETE = 17;         // 1 = a layer before this one did not fit its buffers, in frames in flight
const uint COUNTER_LAYER_LOG = 18;          // what each layer before this one needed, LAYER_LOG_LENGTH counts a layer
const uint COUNTER_COUNT = 27;              // length of the counters buffer

// Each count has a family of three argument sets.
const uint ARGS_PER_COUNT = 3;   // argument sets of a family
const uint ARGS_ITEMS = 0;       // one work-group per element
const uint ARGS_THREADS = 1;     // one thread per element
const uint ARGS_BLOCKS = 2;      // one work-group per BLOCK_SIZE elements

const uint FAMILY_CANDIDATES = 0;     // arguments from COUNTER_CANDIDATES
const uint FAMILY_WORK_ITEMS = 1;     // arguments from COUNTER_WORK_ITEMS
const uint FAMILY_VISIBLE = 2;        // arguments from COUNTER_VISIBLE
const uint FAMILY_SLAB_SPLATS = 3;    // arguments from COUNTER_SLAB_END - COUNTER_SLAB_BEGIN
const uint FAMILY_INTERSECTIONS = 4;  // arguments from COUNTER_SLAB_INTERSECTIONS
const uint FAMILY_COUNT = 5;          // families of indirect arguments

const uint RADIX_BITS = 8;        // bits per radix digit
const uint RADIX_SIZE = 256;      // values of a radix digit
const uint BLOCK_SIZE = 2048;     // elements that one work-group scans or sorts
const uint LAYERS = 4;            // depth layers of a frame that leaves out what is hidden
const uint LAYER_LOG_LENGTH = 3;  // counts that are kept of a layer
const uint LAYER_LOG_WORK_ITEMS = 0;     // its COUNTER_WORK_ITEMS_NEEDED
const uint LAYER_LOG_VISIBLE = 1;        // its COUNTER_VISIBLE
const uint LAYER_LOG_INTERSECTIONS = 2;  // its COUNTER_INTERSECTIONS
const uint LAYER_BIN_BITS = 1048576; // depths whose bits share a bin: an eighth of an octave of f32
const uint LAYER_BINS = 2048;     // bins of depth for choosing the layers: all f32 that are not negative
const uint NO_OFFSET = 0xFFFFFFFF; // Instance.first_offset of an instance without offsets
const uint NO_COLOR = 0xFFFFFFFF;  // Instance.color of what no colour matrix changes

struct DispatchArgs {
    uint x;  // work-groups along x
    uint y;  // work-groups along y
    uint z;  // work-groups along z
};

// The same folding as `Grid::groups` on the host.
DispatchArgs fold_groups(uint groups) {
    const uint row = 65535;
    return DispatchArgs(min(groups, row), groups == 0 ? 0 : (groups + row - 1) / row, 1);
}

// Rounds up without overflow.
uint divide_up(uint n, uint by) {
    return n / by + (n % by == 0 ? 0 : 1);
}

// Saturating sum: counts never wrap to a small number.
uint add_saturating(uint a, uint b) {
    return a > 0xFFFFFFFF - b ? 0xFFFFFFFF : a + b;
}
