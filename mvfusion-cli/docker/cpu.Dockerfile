# mvfusion on the CPU, and on Mesa's Vulkan drivers: llvmpipe for tests, and the GPUs of AMD and Intel with `--device /dev/dri`.
# Built from the root of the repository: docker build --file mvfusion-cli/docker/cpu.Dockerfile --tag mvfusion .
FROM rust:1.95.0-bookworm AS build
WORKDIR /source
COPY . .
RUN cargo install --locked --path mvfusion-cli --features wgpu --root /installed

FROM debian:bookworm-slim
# ffmpeg reads and writes videos.
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install --yes --no-install-recommends ffmpeg libvulkan1 mesa-vulkan-drivers \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --create-home --uid 1001 mvfusion
COPY --from=build /installed/bin/mvfusion /usr/local/bin/mvfusion
USER 1001:1001
# Mesa and wgpu look for it.
ENV XDG_RUNTIME_DIR=/tmp
WORKDIR /work
ENTRYPOINT ["mvfusion"]
CMD ["--help"]
