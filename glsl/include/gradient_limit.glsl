// A gradient that is not below this is none: its square must be a number (f32 ends at 3.4e38).
const float GRADIENT_LIMIT = 1e15;
