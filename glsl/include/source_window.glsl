// Windows of the source Gaussians, for scenes whose arrays are larger than a binding: each dispatch sees the rows of one.
layout(constant_id = 13) const uint WINDOWED = 0;  // 1 = bindings hold the rows of a window

// Source Gaussians of which a dispatch sees the rows.
struct SourceWindow {
    uint first;           // the first source Gaussian
    uint count;           // number of Gaussians at which its chunks may begin
    uvec3 first_in_band;  // first row of the bindings of SH bands 1, 2, 3
};

// True if the chunk that begins with `source` is the window's.
bool in_window(SourceWindow window, uint source) {
    return WINDOWED == 0 || source - window.first < window.count;
}

// Makes the first indices of a range of source Gaussians those of the window's bindings. They may wrap around: with the index in
// the range of a Gaussian that the window sees they do not.
void enter_window(SourceWindow window, inout uint first_source, inout uvec3 first_in_band) {
    if (WINDOWED == 0) return;
    first_source -= window.first;
    first_in_band -= window.first_in_band;
}
