from megalopta.assets_gen.seeding import generator


def test_same_seed_and_purpose_draw_the_same_numbers():
    assert generator(3, "plant", "beech", 2).random() == generator(3, "plant", "beech", 2).random()


def test_every_part_of_the_purpose_and_seed_zero_count():
    keys = [(0, "a"), (1, "a"), (0, "b"), (0, "a", 0), (0, "a", 1), (0, "a", "b")]
    assert len({generator(*key).random() for key in keys}) == len(keys)
