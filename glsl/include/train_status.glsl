// Records of training steps, for the host and for later steps.

const uint STATUS_OVERFLOW = 0;       // sticky: not 0 once a step did not fit its buffers, until the host resets it
const uint STATUS_COUNT = 4;          // length of the status buffer

const uint LOG_STEPS = 64;            // entries of the ring of step records

// Record of a step, for the host to read later.
struct StepRecord {
    uint step;               // the step's number, low 32 bits
    uint overflowed;         // 1 = this step changed nothing
    uint visible;            // splats
    uint intersections;      // (splat, tile) pairs
    uint candidates_needed;  // instance chunks of visible instances
    uint work_items_needed;  // visible chunks
    uint longest_list;       // splats of the tile with the most of them, 0 where lists may have any length
    float ssim;              // mean over pixels and channels
    float l1;                // mean absolute error
    float mse;               // mean squared error
};
