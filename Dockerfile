# syntax of Docker, Podman and Buildah alike. Build: docker build -t ballscrew-observer .
# Run:   docker run --read-only --tmpfs /tmp --cap-drop ALL -v ./config:/config:ro -v observer-log:/var/lib/observer \
#            --device /dev/ttyUSB0 -p 127.0.0.1:7447:7447 ballscrew-observer
# Another base with Python >= 3.11 as python3: --build-arg BASE=…
# What an analyst needs as well (replay, discover, fleet …): --build-arg LOCK=requirements.lock
ARG BASE=python:3.11-slim-bookworm

FROM ${BASE} AS build
ARG LOCK=requirements-daemon.lock
WORKDIR /src
COPY requirements.lock requirements-daemon.lock requirements-build.lock ./
RUN python3 -m venv /opt/build
RUN /opt/build/bin/pip install --no-cache-dir --require-hashes -r requirements-build.lock
RUN python3 -m venv --without-pip /opt/observer
RUN /opt/build/bin/pip --python /opt/observer/bin/python3 install --no-cache-dir --require-hashes -r ${LOCK}
COPY pyproject.toml setup.py build_kernels.py MANIFEST.in README.md LICENSE ./
COPY observer observer
COPY drivers drivers
# The wheel carries the demo's configuration.
COPY config config
# The base has no C compiler: the kernels are built by zig's, of requirements-build.lock, which stays in this stage.
RUN /opt/build/bin/pip wheel --no-cache-dir --no-deps --no-build-isolation --wheel-dir /opt/build/dist .
RUN /opt/build/bin/pip --python /opt/observer/bin/python3 install --no-cache-dir --no-deps /opt/build/dist/*.whl
# The libraries' own tests are a tenth of the image.
RUN find /opt/observer/lib -type d -name tests -prune -exec rm -r {} +

FROM ${BASE}
COPY --from=build /opt/observer /opt/observer
# The only place that is written: the recordings. Everything else may be read-only.
RUN mkdir -p /var/lib/observer /config
ENV PATH=/opt/observer/bin:/usr/local/bin:/usr/bin:/bin \
    PYTHONDONTWRITEBYTECODE=1 \
    PYTHONUNBUFFERED=1 \
    OPENBLAS_NUM_THREADS=1 \
    MPLCONFIGDIR=/tmp
COPY config /config
RUN chown 10001:10001 /var/lib/observer
USER 10001:10001
VOLUME ["/var/lib/observer"]
EXPOSE 7447
STOPSIGNAL SIGTERM
HEALTHCHECK --interval=10s --timeout=5s CMD ["observer", "health"]
ENTRYPOINT ["observer"]
CMD ["run", "--config", "/config/observer.toml"]
