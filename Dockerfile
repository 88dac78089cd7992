# vnav in a container. From the checkout:
#   docker build --tag vnav .
#   docker run --rm --user "$(id -u):$(id -g)" --volume "$PWD:/data" --volume vnav:/home/vnav vnav build-map my_capture
# The volume at /home/vnav keeps compiled code and public sequences from one run to the next.
# python3 .ci/dockerfile_in_chroot.py runs this file where there is no docker.
FROM debian:bookworm-slim

# The Makefile names the libraries that open3d needs of the system.
COPY Makefile /source/
RUN apt-get update \
 && apt-get install --yes --no-install-recommends make python3 python3-venv \
 && make -C /source system \
 && rm -rf /var/lib/apt/lists/*

COPY pyproject.toml constraints.txt README.md LICENSE /source/
COPY vnav /source/vnav
COPY cli /source/cli
COPY configs /source/configs
COPY datasets /source/datasets
RUN python3 -m venv /opt/vnav \
 && /opt/vnav/bin/pip install --no-cache-dir --constraint /source/constraints.txt '/source[export,heic,record3d,ros]'

# Whoever runs it, by --user, too, has a home and a folder to work in.
RUN useradd --no-create-home --home-dir /home/vnav vnav \
 && install --directory --mode 1777 /home/vnav /data
ENV HOME=/home/vnav
USER vnav
WORKDIR /data
ENTRYPOINT ["/opt/vnav/bin/vnav"]
CMD ["--help"]
