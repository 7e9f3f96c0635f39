// Values of the id buffer.

const uint NO_INSTANCE = 0xFFFFFFFF;  // no surface: the pixel transmits at least half of the light
