//! The flags for LPIPS: its network, weights and input range.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use instgs_console::CliError;
use instgs_eval::lpips::weights::{conversion_command, user_weights_path};
use instgs_eval::{EvalError, InputRange, Lpips, Net};

/// Network, weights and input range of LPIPS.
#[derive(Args)]
pub struct LpipsArgs {
    /// Network that LPIPS is computed with
    #[arg(long, value_enum, default_value = "alex", value_name = "NET")]
    lpips_net: NetArg,
    /// Weights of the network [default: instgs-vk/lpips_NET.safetensors in the user's data folder, if that file exists]
    #[arg(long, value_name = "FILE")]
    lpips_weights: Option<PathBuf>,
    /// Range of the network's input: 11 = -1..1, as it was trained; 01 = 0..1, as in the 3DGS paper's metrics.py
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
