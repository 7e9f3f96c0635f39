// Whose surface a pixel shows.

const uint NO_INSTANCE = 0xFFFFFFFF;  // nobody's: the pixel lets half of the light through
