# Every measured figure of README and docs again: `make results` measures what build/results lacks, in
# processor-hours. A file there has its command, the output, and the processor time that it took.
# PAIRS: folder of the sets of docs/results/whole-frames.md, middlebury-half, raft.onnx, rife.onnx and spynet.onnx;
# PANORAMA: a photographed forest, forest.hdr. Figures that need them are measured where they are given.
PAIRS ?=
PANORAMA ?=
R := build/results
OUT = $(R)/$*
SETS := middlebury clean final kitti chairs tartanair others
LIGHTS := ramp20 vignette shadow dispersion2 dispersion5 mismatch20 warm rendering20
NETWORKS := $(PAIRS)/spynet.onnx,$(PAIRS)/spynet.onnx √,$(PAIRS)/raft.onnx,$(PAIRS)/raft.onnx √,$(PAIRS)/rife.onnx,$(PAIRS)/rife.onnx √

boards = python benchmarks/boards.py $(OUT).csv $(LIGHTS)
cameras = python docs/pictures/cameras.py
calibration = python benchmarks/bench_calibration.py
comparison = python benchmarks/bench_compare.py --judging --faults 40 --pairs 20 --identical 60 --seed 300
camera-motion = python docs/pictures/camera_motion.py
camera-motion-errors = python tests/flow/camera_motion_errors.py 200 8 3 30 100
blocks = python docs/pictures/leaderboard.py && cat out/pictures/leaderboard.json && echo
forests = megalopta dataset make $(R)/forests.yaml --out $(OUT) && \
	megalopta benchmark sequence $(OUT) --methods BM LK DIS PM PF --fluxes 1e4 1e5 1e6 --out $(OUT)-ranking && \
	grep ^mean_epe_px $(OUT)-ranking/ranking.csv
demo = rm -rf $(OUT); mkdir $(OUT); for run in first again; do date +%T; \
	HOME=$(CURDIR)/$(OUT) megalopta demo --quick --redo --out $(OUT)/$$run || exit; times; done; date +%T
natural-information = python docs/pictures/natural_information.py
detectors = python docs/pictures/demo.py
readings = python benchmarks/bench_readings.py
challenge = megalopta dataset make challenge --out $(OUT)
stated-errors = python benchmarks/bench_light.py accuracy
rendering = python benchmarks/bench_light.py speeds --presets room open --lights twilight
frames = python benchmarks/bench_light.py costs --lengths 30 --presets open dense rainforest
pairs = megalopta benchmark pairs $(SETS:%=$(PAIRS)/%) --methods "PF,PF-fast,DeepFlow √,DIS √,RLOF tuned,zero" \
	--photons 1,10,100,1000 --out $(OUT).csv
networks = megalopta benchmark pairs $(PAIRS)/middlebury-half --methods "PF,DeepFlow √,zero,$(NETWORKS)" \
	--photons 10,100,1e6 --out $(OUT).csv
statistics = python benchmarks/image_statistics.py $(PANORAMA)

NEED_PAIRS := pairs networks
NEED_PANORAMA := statistics
ALL := boards calibration readings comparison demo challenge camera-motion-errors cameras camera-motion blocks detectors \
	natural-information forests stated-errors rendering frames
HERE := $(ALL) $(if $(PAIRS),$(NEED_PAIRS)) $(if $(PANORAMA),$(NEED_PANORAMA))

.PHONY: results
results: $(R)/machine.txt
	-$(MAKE) --no-print-directory --keep-going $(HERE:%=$(R)/%.txt)
	@for name in $(HERE); do test -e $(R)/$$name.txt || echo "$$name: missing; the error is above"; done
	@$(if $(PAIRS),,echo "$(NEED_PAIRS): missing; give PAIRS=FOLDER")
	@$(if $(PANORAMA),,echo "$(NEED_PANORAMA): missing; give PANORAMA=FILE")

$(R)/%.txt: | $(R)/machine.txt
	{ echo '$($*)'; PATH=$(CURDIR)/$(BIN):$$PATH; $($*) && echo processor time: && times; } > $@.part
	mv $@.part $@

$(R)/machine.txt: | install
	mkdir -p $(R)
	sed -n '/caption: forests.yaml/,/^```$$/{/^sequences/,/^```$$/{/^```/!p}}' docs/how-to/rank.md > $(R)/forests.yaml
	{ date -u; git describe --always --dirty --abbrev=40 --exclude='*'; uname -srm; grep PRETTY_NAME /etc/os-release; lscpu | grep -E '^(CPU\(s\)|Model name)'; \
	grep MemTotal /proc/meminfo; $(BIN)/python -VV; $(BIN)/pip freeze | grep -iE '^(mitsuba|drjit|numpy|numba|opencv.*)='; } > $@.part
	mv $@.part $@
