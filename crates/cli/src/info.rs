//! `instgs-vk info`: features of this machine's devices, and the kernel variants used on them.

use clap::Args;

use instgs_console::device::{self, DeviceArgs};
use instgs_console::table::{Table, grouped};
use instgs_console::{CliError, Printer};
use instgs_vk::gpu::{DeviceCaps, Gpu, GpuError};
use instgs_vk::kernels::Variant;

/// Lists the Vulkan devices: driver, limits, subgroup sizes, and the kernel variant chosen for each.
#[derive(Args)]
#[command(after_help = "Example:\n  instgs-vk info\n  instgs-vk info --json --device llvmpipe")]
pub(super) struct InfoArgs {
    /// Report as JSON on stdout
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(serde::Serialize)]
struct Info {
    version: &'static str,
    devices: Vec<DeviceInfo>,
    /// The device that other commands use by default.
    picked: Picked,
}

#[derive(serde::Serialize)]
struct DeviceInfo {
    index: usize,
    #[serde(flatten)]
    caps: DeviceCaps,
    subgroup_sizes: Vec<u32>,
    variant: Variant,
}

#[derive(serde::Serialize)]
struct Picked {
    name: String,
    driver: String,
    device_heap_bytes: u64,
    variant: Variant,
}

pub(super) fn run(args: &InfoArgs, device_args: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    let devices: Vec<DeviceInfo> = Gpu::list()?.into_iter().enumerate().map(|(i, caps)| device_info(i, caps)).collect();
    if devices.is_empty() {
        let wanted = "with Vulkan 1.3: install a driver, for instance mesa-vulkan-drivers".into();
        return Err(GpuError::NoDevice { wanted, found: "none".into() }.into());
    }
    if !args.json {
        devices.iter().for_each(|device| print_device(device, printer));
    }
    let gpu = device::open(device_args.choice())?;
    let picked = Picked {
        name: gpu.caps().name.clone(),
        driver: gpu.caps().driver.clone(),
        device_heap_bytes: gpu.device_heap_bytes(),
        variant: Variant::for_device(gpu.caps()),
    };
    if args.json {
        return printer.json(&Info { version: env!("CARGO_PKG_VERSION"), devices, picked });
    }
    if !gpu.caps().tuning.is_empty() {
        printer.line(format_args!("tuned to: {}", described(&picked.variant)));
    }
    let heap = grouped(picked.device_heap_bytes >> 20);
    printer.line(format_args!("picked: {} ({heap} MiB of device memory)", picked.name));
    Ok(())
}

fn device_info(index: usize, caps: DeviceCaps) -> DeviceInfo {
    DeviceInfo { index, subgroup_sizes: caps.subgroup_sizes(), variant: Variant::for_device(&caps), caps }
}

fn print_device(device: &DeviceInfo, printer: &Printer) {
    let DeviceInfo { index, caps, subgroup_sizes, variant } = device;
    printer.line(format_args!("device {index}: {} ({})", caps.name, caps.device_type));
    let mut table = Table::default();
    let mut row = |name: &str, value: String| table.row([format!("  {name:<22}{value}")]);
    row("driver", caps.driver.clone());
    row("Vulkan", caps.api_version.clone());
    let sizes: Vec<String> = subgroup_sizes.iter().map(u32::to_string).collect();
    let required = if caps.can_require_subgroup_size { "" } else { " (cannot be required)" };
    row("subgroup sizes", format!("{}{required}", sizes.join(", ")));
    let (threads, subgroups) = (caps.max_workgroup_invocations, caps.max_workgroup_subgroups);
    row("work-group", format!("{threads} threads, {subgroups} subgroups"));
    row("shared memory", format!("{} bytes", grouped(caps.shared_memory_bytes.into())));
    row("largest binding", format!("{} bytes", grouped(caps.max_storage_bytes)));
    row("largest buffer", format!("{} bytes", grouped(caps.max_buffer_bytes)));
    row(
        "timestamps",
        match caps.timestamp_period_ns {
            0.0 => "none".into(),
            period => format!("{period} ns"),
        },
    );
    row("variant", described(variant));
    printer.line(table);
}

/// What the kernels are compiled for, in words.
fn described(variant: &Variant) -> String {
    let Variant {
        subgroup_size,
        workgroup_size,
        radix_workgroup_size,
        match_by_ballot,
        stage_keys,
        blend_workgroup_size,
        tile_size,
        transpose_moments,
        stage_splats,
        splats_unrolled,
        backward_splats_unrolled,
        expand_backward_subgroup_size,
    } = variant;
    let matching = if *match_by_ballot { "ballots" } else { "shuffles" };
    let staging = if *stage_keys { " in shared memory" } else { "" };
    let sharing = if *stage_splats { "shared memory" } else { "shuffles" };
    let narrower = match expand_backward_subgroup_size == subgroup_size {
        true => String::new(),
        false => format!(" ({expand_backward_subgroup_size} in the backward pass of the expansion)"),
    };
    let moments = if *transpose_moments { "transposition" } else { "scattering" };
    format!(
        "subgroup {subgroup_size}{narrower}, work-groups {workgroup_size} (sort {radix_workgroup_size} by {matching}{staging}, \
         blend {blend_workgroup_size}), tiles {tile_size}x{tile_size} (8x8 in training), backward sums by {moments}, \
         splats by {sharing} and unrolled {splats_unrolled} and {backward_splats_unrolled} at a time"
    )
}
