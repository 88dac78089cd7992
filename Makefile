# A bare machine needs python3 (3.11 or newer), python3-venv, make and git; the rest is set up here.
#   make demo        make a capture, map it, find a photo in it, plan a path
#   make test        set-up, the checks of `make check`, the tests that need no capture
#   make test-slow   those of whole chains and large scenes; .ci/run runs both
#   make check       doctor, lint, format, types
#   make test-lower-bounds   the tests with the oldest versions that pyproject.toml allows
#   make lock        constraints.txt anew: the newest versions that it allows
#   make bench       speed against peers            make bench-real   all on ../shared/captures
#   make attack      5,000 hostile inputs, an hour   make attack-long  kills, full disks, two writers
#   make results     docs/results.md, of what these two record in benchmarks/results
#   make pictures    the pictures of README.md and the tutorial, from the demo
#   make docs        all pages as a site: build/site/index.html
#   make clean       everything that make made

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

# What open3d's wheels expect of the system, and the Debian packages that hold it.
LIBRARIES := libEGL.so.1 libGL.so.1 libX11.so.6 libidn2.so.0 libstdc++.so.6 libudev.so.1 libusb-1.0.so.0
PACKAGES := libegl1 libgl1 libx11-6 libidn2-0 libstdc++6 libudev1 libusb-1.0-0

# The versions that are installed; CONSTRAINTS=/dev/null takes the newest that pyproject.toml allows.
CONSTRAINTS := constraints.txt
INSTALL := $(BIN)/pip install --quiet --disable-pip-version-check --constraint $(CONSTRAINTS) --config-settings editable_mode=strict
CAPTURES := ../shared/captures/house ../shared/captures/redkitchen01
DESK := ../shared/captures/fr1_desk
SOURCES := find vnav cli configs datasets -type f ! -name '*.pyc'

# Bytecode is kept, whatever the environment says: tests start hundreds of processes.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: setup demo pictures docs test test-slow test-lower-bounds check lock bench bench-real attack attack-long results clean python system links

setup: python system links

demo: setup
	$(BIN)/vnav demo

pictures: setup
	$(BIN)/python docs/make_pictures.py

docs: setup
	$(BIN)/python docs/make_site.py

test: check
	$(BIN)/pytest -m "not real and not slow" -n auto --dist loadfile

test-slow: setup
	$(BIN)/pytest -m "slow and not real" -n auto --dist loadfile

test-lower-bounds:
	@mkdir -p build
	$(PYTHON) .ci/lower_bounds.py > build/lowest.txt
	$(MAKE) setup VENV=build/lowest CONSTRAINTS=build/lowest.txt
	build/lowest/bin/vnav doctor
	build/lowest/bin/pytest -m "not real" -n auto --dist loadfile

lock:
	rm -rf build/lock
	$(MAKE) setup VENV=build/lock CONSTRAINTS=/dev/null
	{ echo '# What make setup installs, by make lock with $(shell $(PYTHON) --version).'; \
	build/lock/bin/pip freeze --disable-pip-version-check --all --exclude pip --exclude-editable; } > constraints.txt
	rm -rf build/lock

check: setup
	$(BIN)/vnav doctor
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	cd $(VENV) && bin/mypy --strict --config-file ../pyproject.toml --cache-dir ../.mypy_cache -p vnav  # vnav.cli is in it

bench: setup $(VENV)/bench
	$(BIN)/python benchmarks/astar.py --record
	$(BIN)/python benchmarks/steps.py --record
	$(BIN)/python benchmarks/speed.py --record
	$(BIN)/python benchmarks/fusing.py --record
	$(BIN)/python benchmarks/locating.py --record

# Hours. The table at the end tells of runs that failed, too.
bench-real: setup
	$(BIN)/pytest tests/real
	$(BIN)/python benchmarks/accuracy.py $(CAPTURES) $(DESK) --maps bench/maps --record
	$(BIN)/python benchmarks/degraded_photos.py bench/maps/house ../shared/captures/house --record
	$(BIN)/python benchmarks/false_loops.py bench/maps/house ../shared/captures/house --record
	$(BIN)/python benchmarks/moved_furniture.py --record
	-$(BIN)/python benchmarks/repeating.py bench/repeating --record
	-$(BIN)/python benchmarks/handheld.py bench/handheld --still ../shared/captures/house --record
	-$(BIN)/python benchmarks/people.py bench/people --record
	-$(BIN)/python benchmarks/among_people.py bench/people --record
	-$(BIN)/python benchmarks/drawn_walks.py bench/drawn_walks --record
	-$(BIN)/python benchmarks/spoilt_walks.py bench/drawn_walks --record
	-$(BIN)/python benchmarks/composed.py bench/composed $(DESK) --record
	-$(BIN)/python benchmarks/short_range.py bench/short_range --record
	-$(BIN)/python benchmarks/verdicts.py bench/verdicts --record
	$(BIN)/python benchmarks/broken_odometry.py bench/maps/house ../shared/captures/house --record
	-$(BIN)/python benchmarks/front_ends.py bench/front_ends $(CAPTURES) $(DESK) --record
	$(BIN)/python benchmarks/corners.py $(CAPTURES) $(DESK) --record
	$(BIN)/python benchmarks/patent.py --record
	-$(BIN)/python benchmarks/ekf_windows.py ../shared/captures/house $(DESK) --people bench/people/captures/*people[123]* --record
	$(BIN)/python benchmarks/trackers.py --record
	-$(BIN)/python benchmarks/long_recording.py bench/long ../shared/captures/house --record
	-$(BIN)/python benchmarks/wings.py bench/building --cluster --record
	$(BIN)/python benchmarks/hard_versions.py $(CAPTURES) --out bench
	-$(BIN)/vnav evaluate bench/hard.toml --out bench/hard
	-$(BIN)/vnav evaluate bench/seeds.toml --seeds 5 --out bench/seeds
	$(BIN)/python benchmarks/hard_table.py bench --record

attack: setup
	$(BIN)/python benchmarks/attack.py --record

attack-long: setup
	$(BIN)/python benchmarks/attack_long.py --record

results: setup
	$(BIN)/python benchmarks/make_results.py

clean:
	rm -rf $(VENV) build dist demo bench *.egg-info .mypy_cache .pytest_cache .ruff_cache

python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	{ echo "expected Python 3.11 or newer, found $$($(PYTHON) --version 2>&1); install one and name it: make PYTHON=python3.11" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || \
	{ echo "expected Python with venv, found none; on Debian or Ubuntu run: sudo apt-get install python3-venv" >&2; exit 1; }

system:
	@$(PYTHON) -c 'import ctypes; [ctypes.CDLL(name) for name in "$(LIBRARIES)".split()]' 2>/dev/null && exit 0; \
	if [ "$$(id -u)" = 0 ]; then as_root=; \
	elif sudo -n true 2>/dev/null; then as_root="sudo -n"; \
	else as_root=none; fi; \
	if [ "$$as_root" = none ] || ! command -v apt-get >/dev/null; then \
	echo "open3d needs system libraries that are not all here: $(LIBRARIES); install them, on Debian or Ubuntu with: sudo apt-get install $(PACKAGES)" >&2; exit 1; fi; \
	echo "installing the system libraries of open3d: $(PACKAGES)"; \
	export DEBIAN_FRONTEND=noninteractive; \
	$$as_root apt-get update --quiet=2 && $$as_root apt-get install --quiet=2 --yes --no-install-recommends $(PACKAGES)

# A strict editable install links files one by one: links are renewed when the list of files changes.
links: $(VENV)/installed
	@$(SOURCES) | LC_ALL=C sort | cmp --silent - $(VENV)/files && exit 0; \
	$(INSTALL) --no-deps --no-build-isolation --editable . && \
	$(SOURCES) | LC_ALL=C sort > $(VENV)/files

$(VENV)/installed: pyproject.toml $(CONSTRAINTS) | $(BIN)/pip
	@echo "installing what vnav needs, about 2 GB: some minutes"
	$(INSTALL) --editable '.[test]'
	@$(SOURCES) | LC_ALL=C sort > $(VENV)/files
	@touch $@

$(VENV)/bench: $(VENV)/installed
	$(INSTALL) --editable '.[bench]'
	@touch $@

$(BIN)/pip:
	$(PYTHON) -m venv $(VENV)
