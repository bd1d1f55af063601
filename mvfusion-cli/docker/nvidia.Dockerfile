# mvfusion on NVIDIA GPUs, through Vulkan. Needs the NVIDIA Container Toolkit where it runs: docker run --gpus all mvfusion devices
# Built from the root of the repository: docker build --file mvfusion-cli/docker/nvidia.Dockerfile --tag mvfusion .
# For the feature `cuda`, which fetches an LLVM while it is built, and for the toolkit that it needs, add
# --build-arg FEATURES=cuda --build-arg VARIANT=devel
ARG CUDA=12.9.1
ARG VARIANT=base

FROM rust:1.95.0-bookworm AS build
ARG FEATURES=wgpu
WORKDIR /source
COPY . .
RUN cargo install --locked --path mvfusion-cli --features "$FEATURES" --root /installed

FROM nvidia/cuda:${CUDA}-${VARIANT}-ubuntu24.04
# ffmpeg reads and writes videos. Vulkan's loader finds NVIDIA's driver, which the toolkit mounts; GLX and EGL are what that links.
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install --yes --no-install-recommends ffmpeg libegl1 libglx0 libvulkan1 libxext6 \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --create-home --uid 1001 mvfusion
COPY --from=build /installed/bin/mvfusion /usr/local/bin/mvfusion
# Without `graphics`, the toolkit mounts no Vulkan driver.
ENV NVIDIA_VISIBLE_DEVICES=all NVIDIA_DRIVER_CAPABILITIES=compute,graphics,utility XDG_RUNTIME_DIR=/tmp
USER 1001:1001
WORKDIR /work
ENTRYPOINT ["mvfusion"]
CMD ["--help"]
