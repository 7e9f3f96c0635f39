//! Which network LPIPS is computed with, as flags.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use instgs_console::CliError;
use instgs_eval::lpips::weights::{conversion_command, user_weights_path};
use instgs_eval::{EvalError, InputRange, Lpips, Net};

/// Whether LPIPS is measured, and with which weights.
#[derive(Args)]
pub struct LpipsArgs {
    /// Network of LPIPS
    #[arg(long, value_enum, default_value = "alex", value_name = "NET")]
    lpips_net: NetArg,
    /// Its weights [default: instgs-vk/lpips_NET.safetensors in the user's data folder, if it is there]
    #[arg(long, value_name = "FILE")]
    lpips_weights: Option<PathBuf>,
    /// What LPIPS' network is fed: 11 = -1..1, as it was trained; 01 = 0..1, as the 3DGS paper's metrics.py does
    #[arg(long, value_enum, default_value = "11", value_name = "RANGE")]
    lpips_range: RangeArg,
}

#[derive(Clone, Copy, ValueEnum)]
enum NetArg {
    Alex,
    Vgg,
    Squeeze,
}

#[derive(Clone, Copy, ValueEnum)]
enum RangeArg {
    #[value(name = "11")]
    MinusOneToOne,
    #[value(name = "01")]
    ZeroToOne,
}

impl LpipsArgs {
    /// The network; else, if the user named no weights and has none in the data folder, why there is none.
    pub fn open(&self) -> Result<Result<Lpips, String>, CliError> {
        let net = match self.lpips_net {
            NetArg::Alex => Net::Alex,
            NetArg::Vgg => Net::Vgg,
            NetArg::Squeeze => Net::Squeeze,
        };
        let range = match self.lpips_range {
            RangeArg::MinusOneToOne => InputRange::MinusOneToOne,
            RangeArg::ZeroToOne => InputRange::ZeroToOne,
        };
        let path = match (&self.lpips_weights, user_weights_path(net)) {
            (Some(path), _) => path.clone(),
            (None, None) => return Ok(Err("the system names no user's data folder; see --lpips-weights".into())),
            (None, Some(path)) if !path.exists() => {
                let command = conversion_command(net, &path);
                return Ok(Err(format!("{} is not there; make it with: {command}", path.display())));
            }
            (None, Some(path)) => path,
        };
        Ok(Ok(Lpips::load(net, range, &path).map_err(EvalError::from)?))
    }
}
