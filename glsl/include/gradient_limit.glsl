// Gradients that are not below this limit are dropped: their squares must be finite (f32 ends at 3.4e38).
const float GRADIENT_LIMIT = 1e15;
