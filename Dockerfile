# instgs-vk in a container: on a GPU where the runtime hands one in, else on Mesa's CPU driver lavapipe.
#
#   docker build -t instgs-vk .
#   docker run --rm -v "$PWD:/data" instgs-vk info
#   docker run --rm --gpus all -v "$PWD:/data" instgs-vk train park --method instgs     (NVIDIA's container toolkit)
#   docker run --rm --device /dev/dri -v "$PWD:/data" instgs-vk info                    (AMD and Intel: Mesa's drivers)
FROM rust:1.92-bookworm AS build
WORKDIR /src
COPY . .
RUN apt-get update && ./tools/setup
RUN cargo build --release --locked \
    && mkdir /programs \
    && cp target/release/instgs-vk target/release/instgs-player target/release/instgs-evidence /programs/

FROM debian:bookworm-slim
# The Vulkan loader; Mesa's drivers for AMD, Intel and the CPU; what NVIDIA's driver, which the runtime hands in, links to.
RUN apt-get update \
    && apt-get install -y --no-install-recommends libvulkan1 mesa-vulkan-drivers libstdc++6 libx11-6 libxext6 libx11-xcb1 \
       libxkbcommon-x11-0 libxcursor1 libxi6 libxrandr2 ca-certificates \
    && rm -rf /var/lib/apt/lists/*
# Without "graphics" NVIDIA's runtime leaves its Vulkan driver out.
ENV NVIDIA_VISIBLE_DEVICES=all NVIDIA_DRIVER_CAPABILITIES=compute,graphics,utility
COPY --from=build /programs/ /usr/local/bin/
WORKDIR /data
ENTRYPOINT ["instgs-vk"]
CMD ["--help"]
