//! L4: how good pictures are: PSNR, SSIM, LPIPS.
