# Two commands matter: `make demo` and `make test`. Both set everything up first.
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
DOCS_ENV := $(PWD)/out/docs/env
.PHONY: help setup docs demo demo-cell soak faults fuzz browser test coverage audit lint format benchmark bench lock clean

# In the workspace's environment: virtual environment, ROS 2, the built ros2_ws.
RUN := source scripts/env.sh &&
# One thread for BLAS: the planner is measured on one core, and results do not depend on the machine.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1

# The tests of a file share what they prepare, so a file stays in one process.
TEST_PROCESSES ?= -n 2 --dist loadfile

LOCKED := $(PWD)/.venv/bin/uv pip compile -q --python-version 3.11 --generate-hashes \
	--custom-compile-command "make lock"

help:  ## Show this list
	@sed -n 's/^\([a-z-]*\):.*## /  make \1\t/p' $(MAKEFILE_LIST) | expand -t 20

setup:  ## System packages, virtual environment, locked dependencies, colcon build
	@scripts/setup.sh

demo: setup  ## Start the node, publish an object's pose, plan a grasp for the mug, draw it
	@$(RUN) python scripts/demo.py

demo-cell: setup  ## A cell: detections of a moving camera, tf, and an executive that uses the action
	@$(RUN) python scripts/demo_cell.py

soak: setup  ## Many clients at once against a node: lost answers, times, memory (10 min)
	@$(RUN) python tests/benchmarks/node_soak.py $(SOAK_ARGS)

faults: setup  ## 37 kinds of fault on a live node, 20 seeded times each: answers, the next good one (1 h)
	@$(RUN) python tests/benchmarks/node_faults.py $(FAULTS_ARGS)

fuzz: setup  ## 100,000 requests made bad in random places, on a live node (1 h)
	@$(RUN) python tests/benchmarks/node_fuzz.py $(FUZZ_ARGS)

browser: setup
	@scripts/system_packages.sh --browser || echo "No browser: the tests of the viewer's page will be skipped." >&2

test: setup browser lint  ## Lint, types, all tests (real processes over real DDS included)
	@$(RUN) python -m pytest $(TEST_PROCESSES) $(PYTEST_ARGS)

coverage: setup browser  ## Lines and branches of the planner and the node that the tests run
	@$(RUN) python -m pytest -p pytest_cov $(TEST_PROCESSES) --cov --cov-report=term:skip-covered \
		$(PYTEST_ARGS)

# Not with -q: it would hide dead links from --strict.
docs: setup  ## The site of the documentation in out/docs/site; a dead link fails
	@$(RUN) eval "$$(python scripts/uv_settings.py)" && python scripts/docs_site.py && \
		{ [ -x $(DOCS_ENV)/bin/python ] || python -m venv --without-pip $(DOCS_ENV); } && \
		uv pip install -q --python $(DOCS_ENV)/bin/python --require-hashes -r requirements/docs.lock && \
		NO_MKDOCS_2_WARNING=1 $(DOCS_ENV)/bin/mkdocs build
	@echo "out/docs/site/index.html"

audit: setup  ## Known vulnerabilities of the locked dependencies (needs PyPI's advisories)
	@$(RUN) eval "$$(python scripts/uv_settings.py)" && python scripts/audit.py

lint: setup  ## ruff and mypy
	@$(RUN) ruff check . && ruff format --check . && mypy

format: setup  ## Format the sources and mend what ruff can mend
	@$(RUN) ruff check --fix . ; ruff format .

benchmark: setup  ## List the benchmarks, with the command of each
	@echo "Planners on many objects and seeds, with tables, plots and a report:"
	@echo "  .venv/bin/gpis-grasp-benchmark --help"
	@echo "Parts of the planner and the node, each a program of its own (--help lists its options):"
	@for file in tests/benchmarks/*.py; do \
		[ -e "$$file" ] || continue; \
		echo "  source scripts/env.sh && python $$file"; \
		sed -n '1s/^"""/      /p' "$$file" | tr -d '"'; \
	done

bench: setup  ## Benchmarks of each stage, with ratios against the former version (10 min)
	@$(RUN) python tests/benchmarks/bench.py $(BENCH_ARGS)

lock: setup  ## Resolve the dependencies anew (setup.py, benchmark/pyproject.toml, requirements/*.in)
	@$(LOCKED) --upgrade -o requirements/installer.lock requirements/installer.in
	@$(LOCKED) --upgrade -o requirements/docs.lock requirements/docs.in
	@$(LOCKED) --upgrade -o requirements/requirements.lock \
		--extra step --extra cloud --extra pictures --extra cluster \
		--no-emit-package gpis-grasp-planner ros2_ws/src/gpis_grasp_planner/setup.py \
		benchmark/pyproject.toml requirements/ros.in requirements/development.in

clean:  ## Remove everything that the other targets made, the virtual environment included
	rm -rf .venv ros2_ws/{build,install,log} out .pytest_cache .ruff_cache .mypy_cache .hypothesis
	find ros2_ws/src benchmark tests scripts \( -name __pycache__ -o -name '*.egg-info' \) -prune -exec rm -rf {} +
