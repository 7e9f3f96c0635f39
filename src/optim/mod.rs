//! L3: Adam on the device, one state per parameter buffer.
