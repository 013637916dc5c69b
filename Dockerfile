# docker build -t megalopta .
# docker run --rm -v "$PWD/out:/work/out" megalopta                     as `make demo`: out/demo/report.html
# docker run --rm --entrypoint make megalopta test                      the tests
# With an NVIDIA GPU and its container toolkit, which supplies the driver with OptiX:
#   docker build -t megalopta:cuda --build-arg BASE=nvidia/cuda:12.9.1-base-ubuntu24.04 .
#   docker run --rm --gpus all -e NVIDIA_DRIVER_CAPABILITIES=compute,graphics,utility megalopta:cuda info
ARG BASE=debian:trixie-slim
FROM ${BASE}
ENV DEBIAN_FRONTEND=noninteractive
RUN apt-get update \
    && apt-get install -y --no-install-recommends ca-certificates g++ git libatomic1 make python3 python3-dev python3-venv \
    && rm -rf /var/lib/apt/lists/*
RUN useradd --create-home bee
COPY --chown=bee . /work
USER bee
WORKDIR /work
ENV PATH=/work/.venv/bin:$PATH PIP_NO_CACHE_DIR=1
RUN make install
ENTRYPOINT ["megalopta"]
CMD ["demo", "--out", "out/demo"]
