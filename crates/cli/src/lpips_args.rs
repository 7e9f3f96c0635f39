//! The flags for LPIPS: its network, weights and input range.

use std::path::{Path, PathBuf};

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
    fn net(&self) -> Net {
        match self.lpips_net {
            NetArg::Alex => Net::Alex,
            NetArg::Vgg => Net::Vgg,
            NetArg::Squeeze => Net::Squeeze,
        }
    }

    /// The file of weights: the one that the user named, or that in the data folder.
    ///
    /// # Errors
    /// The user named none and the data folder has none: LPIPS is to be left out for this reason.
    pub fn weights(&self) -> Result<PathBuf, CliError> {
        if let Some(path) = &self.lpips_weights {
            return Ok(path.clone());
        }
        let net = self.net();
        let path = user_weights_path(net)
            .ok_or_else(|| CliError::msg("the system names no user's data folder; see --lpips-weights"))?;
        if !path.exists() {
            let command = conversion_command(net, &path);
            return Err(CliError::msg(format!("{} does not exist; make it with: {command}", path.display())));
        }
        Ok(path)
    }

    /// The network with these [`weights`](Self::weights).
    ///
    /// # Errors
    /// The file is missing, damaged, or that of another network.
    pub fn load(&self, weights: &Path) -> Result<Lpips, EvalError> {
        let range = match self.lpips_range {
            RangeArg::MinusOneToOne => InputRange::MinusOneToOne,
            RangeArg::ZeroToOne => InputRange::ZeroToOne,
        };
        Ok(Lpips::load(self.net(), range, weights)?)
    }
}
