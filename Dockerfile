# edc-swarm in a container: `docker compose up` (compose.yaml) runs one for every UAV.
#
# The guidance is compiled at build into a library for any processor of this kind. So the image needs no compiler:
# numba and LLVM (170 MB) stay in the stage that builds it.
#
# It holds what a UAV, a head, router, recorder, visualiser and operator need. EXTRAS adds what some services alone need
# (compose.yaml): `live` the live view (54 MB), `plots` figures (100 MB); `secure` (16 MB) makes certificates.

ARG EXTRAS=secure

FROM python:3.11-slim AS build
ARG EXTRAS
WORKDIR /src
RUN apt-get update -qq && apt-get install -y -qq --no-install-recommends binutils
RUN python -m venv /opt/edc-swarm
ENV PATH=/opt/edc-swarm/bin:$PATH PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1
COPY pyproject.toml constraints.txt ./
# What changes seldom comes first, so that a change of the code installs no library anew.
RUN python -c "import tomllib; p = tomllib.load(open('pyproject.toml', 'rb')); o = p['project']['optional-dependencies']; print(*p['build-system']['requires'], *p['project']['dependencies'], *(line for extra in '$EXTRAS'.split(',') if extra for line in o[extra]), sep='\n')" > requirements.txt \
    && pip install --quiet -c constraints.txt -r requirements.txt
COPY README.md LICENSE hatch_build.py ./
COPY edc_swarm edc_swarm
COPY processes processes
# strip damages the libraries in *.libs, which wheels have patched.
RUN pip install --quiet --no-deps --no-build-isolation . \
    && cd / && python -m processes.uav.compile_ahead --library /opt/edc-swarm/lib/python3*/site-packages/edc_swarm/planner \
    && pip uninstall --quiet --yes numba llvmlite hatchling trove-classifiers setuptools pip \
    && find /opt/edc-swarm -type d -name tests -path '*/site-packages/*' -prune -exec rm -rf {} + \
    && find /opt/edc-swarm -name '*.so' -type f -not -path '*.libs/*' -exec strip --strip-unneeded {} +

FROM python:3.11-slim
ARG EXTRAS
RUN useradd --uid 1000 --create-home edc \
    && install -d -o edc -g edc /swarm /swarm/recordings /swarm/certs /home/edc/state
# For services that are started as root only to become whoever owns the recordings on the host.
RUN printf '%s\n' '#!/bin/sh' 'owner=$(stat -c "--reuid=%u --regid=%g" /swarm/recordings)' \
        'exec setpriv $owner --clear-groups "$@"' > /usr/local/bin/as-owner \
    && chmod 755 /usr/local/bin/as-owner
COPY --from=build /opt/edc-swarm /opt/edc-swarm
ENV PATH=/opt/edc-swarm/bin:$PATH PYTHONUNBUFFERED=1 EDC_SWARM_EXTRAS=$EXTRAS \
    MPLCONFIGDIR=/tmp/matplotlib
USER edc
WORKDIR /swarm
ENTRYPOINT ["edc-swarm"]
CMD ["--help"]
