// How the number of Gaussians changes between steps: counts and codes of the strategies.

const uint COUNTER_GAUSSIANS = 10;    // Gaussians before: set by the host
const uint COUNTER_KEPT = 11;         // Gaussians that stay as they are if nothing grows
const uint COUNTER_DENSIFIED = 12;    // Gaussians after
const uint COUNTER_CLONED = 13;       // Gaussians that got a copy
const uint COUNTER_SPLIT = 14;        // Gaussians that were replaced by smaller ones
const uint COUNTER_WEIGHTS = 11;      // sum of the fixed-point opacities that relocation draws from
const uint COUNTER_RELOCATED = 13;    // dead Gaussians that were moved onto others

const uint GROWTH_NONE = 0;           // stays or goes
const uint GROWTH_CLONE = 1;          // stays or goes, and leaves a copy
const uint GROWTH_SPLIT = 2;          // is replaced by smaller ones

const uint MADE_KEPT = 0;             // a Gaussian as it was, with its moments
const uint MADE_CLONE = 1;            // a copy
const uint MADE_CHILD = 2;            // and above: child number `made - MADE_CHILD` of a split Gaussian
