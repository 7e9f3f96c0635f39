// Parameters of a scan. The including file declares `counters` before.

struct Scan {
    uint count_slot;   // counter that holds the number of elements
    uint begin_slot;   // counter that holds the first element to count, earlier ones add 0; COUNTER_COUNT = none
    uint total_slot;   // counter that gets the total, limited to the capacity; COUNTER_COUNT = none
    uint needed_slot;  // counter that gets the unlimited total; COUNTER_COUNT = none
    uint capacity;     // limit of the total
    uint family;       // indirect arguments to write from the limited total; FAMILY_COUNT = none
};

layout(scalar, push_constant) uniform ScanParams {
    Scan scan;  // the scan to do
};

uint scan_length() {
    return counters[scan.count_slot];
}
