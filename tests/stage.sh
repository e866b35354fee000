#!/bin/sh
# The stages of `make test`, in build/test:
#   stage.sh run NAME COMMAND...  runs one and keeps what it prints and how it ends; it succeeds
#                                 all the same, so that the others go on
#   stage.sh sum NAME...          says how each of them ended; fails if one has not passed
set -u
folder=build/test

# How long a stage has taken, and of one processor: of several at once each has a share.
seconds() {
	[ -f "$folder/$1.seconds" ] || return 0
	printf '%5d s, %5d s CPU' "$(cat "$folder/$1.seconds")" \
		"$(tail -n 1 "$folder/$1.times" | tr 'ms' '  ' | awk '{printf "%d", 60 * ($1 + $3) + $2 + $4}')"
}

# The lines of a stage that say what it did.
words() {
	grep -E '^(Blender|C tests) .*: |^[0-9]+ passed, ' "$folder/$1.log" ||
		tail -n 1 "$folder/$1.log" | sed 's/^=* //; s/ =*$//'
}

case $1 in
run)
	name=$2
	shift 2
	echo "== $name"
	mkdir -p "$folder"
	start=$(date +%s)
	{
		"$@" 2>&1
		echo $? >"$folder/$name.code"
		times >"$folder/$name.times"
	} | tee "$folder/$name.log"
	echo $(($(date +%s) - start)) >"$folder/$name.seconds"
	;;
sum)
	shift
	passed=0 failed=0 skipped=0
	echo '== summary'
	for name in "$@"; do
		code=$(cat "$folder/$name.code" 2>/dev/null)
		if [ "$code" != 0 ]; then
			failed=$((failed + 1))
			outcome=FAILED
			said=$(grep -hE '^(FAILED|ERROR) ' "$folder/$name.log" 2>/dev/null | head -n 20)
			said="${said:-${code:+see $folder/$name.log}}"
			said="${said:-it did not run}"
		else
			said=$(words "$name")
			if echo "$said" | grep -qv ': skipped: '; then
				passed=$((passed + 1))
				outcome=passed
			else
				skipped=$((skipped + 1))
				outcome=skipped
			fi
		fi
		printf '%-8s %-12s %s\n' "$outcome" "$name" "$(seconds "$name")"
		echo "$said" | sed 's/^/         /'
	done
	echo "stages: $passed passed, $failed failed, $skipped skipped"
	[ "$failed" -eq 0 ]
	;;
esac
