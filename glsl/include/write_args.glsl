// Indirect arguments for `n` elements. The including file declares `args`; its WORKGROUP_SIZE is that of the consumers.
void write_args(uint family, uint n) {
    args[family * ARGS_PER_COUNT + ARGS_ITEMS] = fold_groups(n);
    args[family * ARGS_PER_COUNT + ARGS_THREADS] = fold_groups(divide_up(n, WORKGROUP_SIZE));
    args[family * ARGS_PER_COUNT + ARGS_BLOCKS] = fold_groups(divide_up(n, BLOCK_SIZE));
}
